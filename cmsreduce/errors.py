"""All exceptions of the package. A message gives the fault, the place, the size and the remedy."""

__all__ = [
    "CmsReduceError",
    "ConfigError",
    "ConstraintError",
    "DampingError",
    "DofMapError",
    "FloatingFrameError",
    "MatrixError",
    "ReadError",
    "SceneError",
    "SingularInterfaceError",
    "StageError",
    "UnitsError",
    "WriteError",
]


class CmsReduceError(Exception):
    """Base of every error that the user can correct; the command line prints it and exits with 2."""


class ConfigError(CmsReduceError):
    """A pipeline file that does not follow the grammar."""


class ReadError(CmsReduceError):
    """A file that is missing, truncated, of an unknown format, or without the data needed."""


class MatrixError(CmsReduceError):
    """A matrix that is not finite, not symmetric, indefinite, or of the wrong size."""


class DofMapError(CmsReduceError):
    """Rows of a matrix that do not belong to their dofs."""


class UnitsError(CmsReduceError):
    """Units that are unknown, of the wrong dimension, or inconsistent."""


class SceneError(CmsReduceError):
    """A joint, actuator, sensor or angle that does not fit the bodies."""


class ConstraintError(CmsReduceError):
    """Joints that constrain the same motion twice."""


class SingularInterfaceError(CmsReduceError):
    """An interface that leaves a rigid motion of the body free where the mode set needs it held."""


class FloatingFrameError(CmsReduceError):
    """A floating frame that the motions of a body do not determine."""


class DampingError(CmsReduceError):
    """Damping that is missing or not positive where the method needs it."""


class StageError(CmsReduceError):
    """A stage that was started before the stages that it needs."""


class WriteError(CmsReduceError):
    """A result that cannot be written to its place."""
