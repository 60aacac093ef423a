"""A good study on disk, to run and to break."""

from tests.pipeline.conftest import finished_study, good_study, ran, study

__all__ = ["finished_study", "good_study", "ran", "study"]
