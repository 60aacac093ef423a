"""Mode sets: each turns a finite-element body into a small one.

A base class owns projection and recovery; a method supplies only its shapes.
The choice among the modes of a set belongs in `balance`.
"""

from cmsreduce.errors import ConfigError
from cmsreduce.model import InterfaceLoading
from cmsreduce.reduce.benfield_hruda import AugmentedBody, BenfieldHruda
from cmsreduce.reduce.characteristic import InterfaceReduction
from cmsreduce.reduce.craig_bampton import CraigBampton, Guyan
from cmsreduce.reduce.macneal_rubin import MacNealRubin
from cmsreduce.reduce.reduction import Examined, Reduction, kept_rigid, project
from cmsreduce.reduce.response_body import ResponseBody
from cmsreduce.reduce.scene_krylov import SceneKrylov

__all__ = [
    "AugmentedBody",
    "BenfieldHruda",
    "CraigBampton",
    "Examined",
    "Guyan",
    "InterfaceLoading",
    "InterfaceReduction",
    "METHODS",
    "MacNealRubin",
    "Reduction",
    "ResponseBody",
    "SceneKrylov",
    "kept_rigid",
    "project",
    "reduction",
]

METHODS: dict[str, type[Reduction]] = {
    kind.method: kind for kind in (CraigBampton, MacNealRubin, BenfieldHruda, AugmentedBody, Guyan, SceneKrylov)
}
"""Mode sets by name."""


def reduction(
    method: str,
    cutoff_hz: float,
    interface_reduction: InterfaceReduction | None = None,
    loading: InterfaceLoading | None = None,
    *,
    damped: bool = False,
    inertia: bool = False,
) -> Reduction:
    """Make the mode set of a name.

    Parameters
    ----------
    method : str
        Name of the mode set.
    cutoff_hz : float
        Normal modes are kept up to this frequency.
    interface_reduction : InterfaceReduction, optional
        For the sets that have constraint modes.
    loading : InterfaceLoading, optional
        For the sets whose modes are loaded by the neighbours.
    damped : bool
        Also span the damped modes, for craig-bampton and macneal-rubin.
    inertia : bool
        Also span the response to the inertia of the static shapes, for sets that have some.

    Raises
    ------
    ConfigError
        If there is none of that name, it has no constraint modes to reduce, no damped modes, or no static shapes.
    """
    if method not in METHODS:
        raise ConfigError(f"reduce: method '{method}' is not available (there are: {', '.join(METHODS)})")
    kind = METHODS[method]
    if damped and kind not in (CraigBampton, MacNealRubin):
        raise ConfigError(f"reduce: {method} has no damped modes; use craig-bampton or macneal-rubin")
    if inertia and kind not in (CraigBampton, MacNealRubin, Guyan):
        raise ConfigError(
            f"reduce: {method} has no static shapes of its own, so `inertia` does not apply to it; use craig-bampton, "
            "macneal-rubin or guyan"
        )
    if issubclass(kind, CraigBampton):
        return kind(cutoff_hz, interface_reduction=interface_reduction, damped=damped, inertia=inertia)
    if interface_reduction is not None:
        raise ConfigError(f"reduce: {method} has no constraint modes, so `interface_cutoff` does not apply to it")
    if issubclass(kind, BenfieldHruda):
        return kind(cutoff_hz, loading)
    return kind(cutoff_hz, damped=damped, inertia=inertia) if damped or inertia else kind(cutoff_hz)
