"""The planners of one task: one an object, in the task's order."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ocplanner.envs.tasks import Task
from ocplanner.envs.tasks import task as task_spec
from ocplanner.errors import MismatchError
from ocplanner.planner.planner import Planner

_ALIKE = ("task", "observe", "visual", "image_size", "mask_rgb", "seed")


class TaskPlanners:
    """What plans for each object of a task; for most tasks, one planner.

    Args:
        planners: one an object that the task is about, in any order.

    Attributes:
        planners: in the task's order.
        task: the task.
        config: of the first; all of them see the same pictures, but not necessarily of the same cameras.
        cameras: those of all planners.
        sha256: of the file; of several files those of each, joined by ``+``.

    Raises:
        MismatchError: an object has no planner or two, or they do not see or know the same.
    """

    def __init__(self, planners: Sequence[Planner]) -> None:
        first = planners[0]
        self.task: Task = task_spec(str(first.config["task"]))
        for other in planners[1:]:
            _check_alike(first, other)
        parts = [part for spec in self.task.objects for part in spec.parts]
        by_object: dict[str, Planner] = {}
        for planner in planners:
            name = str(planner.config["object"])
            if name not in parts:
                raise MismatchError(
                    f"{planner.path} plans for the object {name!r}, which {self.task.name} does not have"
                )
            if by_object.setdefault(name, planner) is not planner:
                raise MismatchError(
                    f"{by_object[name].path} and {planner.path} both plan for {name} of {self.task.name}; name one "
                    "planner an object"
                )
        missing = [part for part in parts if part not in by_object]
        if missing:
            named = ", ".join(str(planner.path) for planner in planners)
            raise MismatchError(
                f"{self.task.name} has no planner for {', '.join(missing)} in {named}; name one planner an object, "
                f"each trained with `ocplanner train-planner --object NAME`"
            )
        self.planners = tuple(by_object[part] for part in parts)
        self.config: Mapping[str, Any] = self.planners[0].config
        self.cameras = tuple(dict.fromkeys(name for planner in self.planners for name in planner.config["cameras"]))
        self.sha256 = "+".join(planner.sha256 for planner in self.planners)

    @classmethod
    def of(cls, planners: "TaskPlanners | Planner | str | Path | Sequence[Planner | str | Path]") -> "TaskPlanners":
        """Planners in whatever form they are given: one, its file, or several.

        Raises:
            ModelFileError: a file is no planner.
            MismatchError: they do not make up a task.
        """
        if isinstance(planners, TaskPlanners):
            return planners
        several = [planners] if isinstance(planners, Planner | str | Path) else list(planners)
        return cls([each if isinstance(each, Planner) else Planner.load(each) for each in several])

    @property
    def by_object(self) -> dict[str, Planner]:
        """The planners by the object that they plan for, or the part that one arm has in carrying it."""
        return {str(planner.config["object"]): planner for planner in self.planners}

    @property
    def paths(self) -> tuple[Path, ...]:
        """Their files."""
        return tuple(Path(planner.path).absolute() for planner in self.planners)

    def __str__(self) -> str:
        """Their files, for messages."""
        return " and ".join(str(planner.path) for planner in self.planners)


def _check_alike(first: Planner, other: Planner) -> None:
    for key in _ALIKE:
        a, b = first.config.get(key), other.config.get(key)
        if a != b:
            raise MismatchError(
                f"{first.path} and {other.path} cannot work together: {key} is {a} for the one and {b} for the other"
            )
