"""The one exception family: what is wrong, where, by how much, and what to do about it."""

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
    """Base of every error an engineer can mend; the command line prints it and exits with 2."""


class ConfigError(CmsReduceError):
    """A pipeline file that does not follow the grammar: file, line, key, remedy."""


class ReadError(CmsReduceError):
    """A file that is missing, truncated, of an unknown format, or without what was asked of it."""


class MatrixError(CmsReduceError):
    """A matrix that is not finite, not symmetric, indefinite, or of the wrong size."""


class DofMapError(CmsReduceError):
    """Rows of a matrix that do not belong to the dofs they are said to belong to."""


class UnitsError(CmsReduceError):
    """Units that are unknown, of the wrong dimension, or do not fit together."""


class SceneError(CmsReduceError):
    """A joint, actuator, sensor or angle that does not fit the bodies."""


class ConstraintError(CmsReduceError):
    """Joints that constrain the same motion twice."""


class SingularInterfaceError(CmsReduceError):
    """An interface that does not hold the body where the mode set needs it held."""


class FloatingFrameError(CmsReduceError):
    """A floating frame that the motions of a body do not determine."""


class DampingError(CmsReduceError):
    """Damping that is absent or not positive where the mathematics needs it."""


class StageError(CmsReduceError):
    """A stage asked for before the stages it builds on have been run."""


class WriteError(CmsReduceError):
    """A result that cannot be written where it belongs."""
