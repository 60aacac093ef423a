"""Mode sets: each turns a finite-element body into a small one."""

from cmsreduce.errors import ConfigError
from cmsreduce.reduce.craig_bampton import CraigBampton, Guyan
from cmsreduce.reduce.reduction import Reduction, project, recover

__all__ = ["METHODS", "CraigBampton", "Guyan", "Reduction", "project", "recover", "reduction"]

METHODS: dict[str, type[Reduction]] = {kind.method: kind for kind in (CraigBampton, Guyan)}
"""Mode sets by name."""


def reduction(method: str, cutoff_hz: float) -> Reduction:
    """Make the mode set of a name.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    if method not in METHODS:
        raise ConfigError(f"reduce: method '{method}' is not available (there are: {', '.join(METHODS)})")
    return METHODS[method](cutoff_hz)
