"""The errors that a user can cause, one class for each kind.

Each message names the thing, the value found and the remedy. The command line prints it without a traceback and exits
with status 2.
"""

from collections.abc import Iterable


class OcplannerError(Exception):
    """Base class of all errors that ocplanner raises on purpose."""


class ShapeError(OcplannerError, ValueError):
    """An array has the wrong shape, dtype or memory order."""


class InvalidValueError(OcplannerError, ValueError):
    """A number is outside its domain, or is NaN or infinite."""


class DatasetError(OcplannerError):
    """A data set is missing, unreadable or damaged, or lacks what is needed."""


class ObjectLayoutError(DatasetError):
    """The layout of the ``object`` observation is unknown, or contradicts the states."""


class ModelFileError(OcplannerError):
    """A planner or policy file is missing, damaged, or made for something else."""


class MismatchError(OcplannerError):
    """Two things that must agree do not, such as task, camera, image size, visual preset or observation."""


class UnknownNameError(OcplannerError, ValueError):
    """A robot, task, camera or option that does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self._parts = (kind, name, tuple(sorted(known)))
        super().__init__(f"unknown {kind} {name!r}; known: {', '.join(self._parts[2])}")

    def __reduce__(self) -> tuple[type["UnknownNameError"], tuple[str, str, tuple[str, ...]]]:
        """Pickle the parts, so that the error survives the way back from a worker process."""
        return type(self), self._parts


class RenderingError(OcplannerError):
    """Headless OpenGL does not work, or drew an unusable image."""


class VersionError(OcplannerError, ImportError):
    """A dependency is missing, or its version does not work with ocplanner."""


class ResultFileError(OcplannerError):
    """A result file or run folder is missing or damaged, or has nothing to report."""


class OutputError(OcplannerError):
    """An output cannot be written: full disk, read-only folder, existing file, or another process is writing it."""


class TrainingError(OcplannerError):
    """Training cannot continue: a loss is not finite, or the run folder belongs to another configuration."""


class WorkerError(OcplannerError):
    """A worker raised an unexpected exception, or died repeatedly on the same episode."""


class ClusterError(OcplannerError):
    """No Ray cluster answers at the address, or its machines cannot run workers."""
