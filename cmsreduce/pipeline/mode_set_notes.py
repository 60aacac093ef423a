"""What a body's mode set depends on, and lacks, that a reader may not expect, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cmsreduce.model import Scene
from cmsreduce.reduce import METHODS, BenfieldHruda

__all__ = ["mode_set_notes"]


def mode_set_notes(name: str, method: str, missed: Mapping[str, float], scene: Scene) -> Iterator[str]:
    """Say what a reader must know of a reduced body.

    Parameters
    ----------
    name : str
        The body.
    method : str
        Its mode set.
    missed : mapping of load to float
        Share of the static flexibility that the basis lacks under loads of the scene.
    scene : Scene
        Its configurations.
    """
    for load, share in missed.items():
        yield (
            f"{name}: its basis has no static shape for {load} and lacks {share:.0%} of the static flexibility "
            "there; name it in `residuals` to add it"
        )
    if issubclass(METHODS[method], BenfieldHruda):
        turned = any(any(setting.angles.values()) for setting in scene.configurations)
        elsewhere = "; at the other configurations the loading differs" if turned else ""
        yield f"{name}: {method} loads it by its neighbours as they stand 'as built'{elsewhere}"
