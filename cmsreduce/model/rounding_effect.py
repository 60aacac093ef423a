"""What rounding the numbers of a reduced body to single precision does to it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["RoundingEffect"]

# What the limits of a run usually allow a frequency.
_FREQUENCY = 1e-3
# A false spring that moves the lowest elastic frequency by 5e-5.
_RIGID = 1e-2


@dataclass(frozen=True)
class RoundingEffect:
    """Largest changes of a body in two forms; zero where there is nothing to change.

    Parameters
    ----------
    free : float
        Relative, of the natural frequencies, modal mass and stiffness rounded.
    held : float
        Relative, of those with every interface held, the shapes at the interfaces rounded, too: what joints lead to.
        Infinite if a frequency is lost.
    rigid_hz : float
        Frequency that a rigid motion gets where neighbours move all interfaces as one.
    boundary_free : float
        Relative, of the natural frequencies, mass and stiffness rounded in interface dofs and modes with them held: a
        superelement. 0 for a body that cannot be one.
    boundary_rigid_hz : float
        Frequency that a rigid motion gets in that form.
    lowest_hz : float
        Lowest elastic frequency, by which to judge the rigid motions.
    """

    free: float = 0.0
    held: float = 0.0
    rigid_hz: float = 0.0
    boundary_free: float = 0.0
    boundary_rigid_hz: float = 0.0
    lowest_hz: float = 0.0

    @property
    def modal_matters(self) -> bool:
        """Whether the modal form loses what an engineer would see."""
        return max(self.free, self.held) > _FREQUENCY or self.rigid_hz > _RIGID * self.lowest_hz

    @property
    def boundary_matters(self) -> bool:
        """Whether the form of interface dofs does."""
        return self.boundary_free > _FREQUENCY or self.boundary_rigid_hz > _RIGID * self.lowest_hz
