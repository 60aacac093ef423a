"""Scenes that import a consumer are not collected where it is not installed; their tests are then skipped."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("exudyn") else ["exudyn_scene.py", "galileo.py"]
