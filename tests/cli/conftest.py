"""A good study on disk, to run and to break."""

from tests.pipeline.conftest import good_study, study

__all__ = ["good_study", "study"]
