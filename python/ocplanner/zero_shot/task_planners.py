"""The planners of one task: one an object, in the task's order."""

from collections.abc import Sequence
from pathlib import Path

from ocplanner.envs.tasks import Task
from ocplanner.envs.tasks import task as task_spec
from ocplanner.errors import MismatchError
from ocplanner.files.records.planner import PlannerHeader
from ocplanner.planner.planner import Planner

_ALIKE = ("task", "observe", "visual", "image_size", "mask_rgb", "seed")
"""What the planners of one task must agree on."""


class TaskPlanners:
    """A planner for each object of a task; for most tasks, one planner.

    Args:
        planners: one for each object that the task is about, in any order.

    Attributes:
        planners: in the task's order.
        task: the task.
        header: header of the first; all see the same images, but not necessarily of the same cameras.
        cameras: cameras of all planners.
        sha256: hash of the file; of several files, their hashes joined by ``+``.

    Raises:
        MismatchError: there is no planner, an object has none or two, or they were trained on different images.
    """

    def __init__(self, planners: Sequence[Planner]) -> None:
        if not planners:
            raise MismatchError("no planner is given; name its file with --planner")
        first = planners[0]
        self.task: Task = task_spec(first.header.task)
        for other in planners[1:]:
            _check_alike(first, other)
        parts = [part for spec in self.task.objects for part in spec.parts]
        by_object: dict[str, Planner] = {}
        for planner in planners:
            name = planner.header.object
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
        self.header: PlannerHeader = self.planners[0].header
        self.cameras = tuple(dict.fromkeys(name for planner in self.planners for name in planner.header.cameras))
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
        """The planners by the object that they plan for, or by the part that one arm has in carrying it."""
        return {planner.header.object: planner for planner in self.planners}

    @property
    def paths(self) -> tuple[Path, ...]:
        """Their files."""
        return tuple(Path(planner.path).absolute() for planner in self.planners)

    def __str__(self) -> str:
        """Their files, for messages."""
        return " and ".join(str(planner.path) for planner in self.planners)


def _check_alike(first: Planner, other: Planner) -> None:
    for key in _ALIKE:
        a, b = getattr(first.header, key), getattr(other.header, key)
        if a != b:
            raise MismatchError(
                f"{first.path} and {other.path} cannot work together: {key} is {a} for the one and {b} for the other"
            )
