"""Scenes that import a consumer are not collected where it is not installed; their tests are then skipped."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.consumers.exported import finished_robot

collect_ignore = [] if find_spec("exudyn") else ["exudyn_scene.py", "galileo.py"]


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run directory of the scene with a joint of every kind."""
    return finished_robot(tmp_path_factory.mktemp("robot"))
