"""Every error that a user can cause, one class each.

A message names the thing, the value found and the remedy. The command line prints it without a traceback and exits
with status 2.
"""

from collections.abc import Iterable


class OcplannerError(Exception):
    """Base of all errors that ocplanner raises on purpose."""


class ShapeError(OcplannerError, ValueError):
    """An array has the wrong shape, dtype or memory order."""


class InvalidValueError(OcplannerError, ValueError):
    """A number is outside its domain, NaN and infinity included."""


class DatasetError(OcplannerError):
    """A data set is missing, truncated, or lacks what was asked of it."""


class ObjectLayoutError(DatasetError):
    """The order of the ``object`` observation cannot be told, or contradicts the states."""


class ModelFileError(OcplannerError):
    """A planner or policy file is missing, damaged, or made for something else."""


class MismatchError(OcplannerError):
    """Two things that must agree do not: task, camera, image size, visual preset or observation."""


class UnknownNameError(OcplannerError, ValueError):
    """A robot, task, camera or option that does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self._parts = (kind, name, tuple(sorted(known)))
        super().__init__(f"unknown {kind} {name!r}; known: {', '.join(self._parts[2])}")

    def __reduce__(self) -> tuple[type["UnknownNameError"], tuple[str, str, tuple[str, ...]]]:
        """Survive the way back from a worker process."""
        return type(self), self._parts


class RenderingError(OcplannerError):
    """No working headless OpenGL, or a render came back unusable."""


class VersionError(OcplannerError, ImportError):
    """An installed dependency is outside the range that works."""


class ResultFileError(OcplannerError):
    """A result file or run folder is missing or damaged, or holds nothing to report."""


class OutputError(OcplannerError):
    """A result cannot be written: disk full, read-only folder, or another process is writing it."""


class TrainingError(OcplannerError):
    """Training cannot go on: a loss is not finite, or a run folder belongs to another configuration."""


class WorkerError(OcplannerError):
    """A worker process died again and again on the same episode."""


class ClusterError(OcplannerError):
    """There is no Ray cluster at the address, or its machines cannot run workers."""
