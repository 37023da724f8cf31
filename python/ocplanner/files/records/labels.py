"""How ``ocplanner label`` made hints and rewards: the attribute ``ocplanner_label`` of a data set's ``data``.

Policies trained on such a data set carry the record along in their files.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ocplanner.files.records.planner import Observe, Outputs
from ocplanner.settings import build, to_dict

LABEL_ATTRIBUTE = "ocplanner_label"


FrameName = Literal["world", "base"]
"""The frame of a data set's actions: the world's, or that of the arm's base."""


@dataclass(frozen=True)
class ActionScale:
    """What an action of 1 asks for in a control step: metres and radians."""

    position: float
    rotation: float


@dataclass(frozen=True)
class LabelledBy:
    """The planner that made the labels; see :class:`ocplanner.files.records.planner.PlannerHeader`."""

    task: str
    object: str
    outputs: Outputs
    horizon: int
    observe: Observe
    cameras: tuple[str, ...]


@dataclass(frozen=True)
class FileIdentity:
    """Name and size of a file, to recognise it by."""

    name: str
    bytes: int


@dataclass(frozen=True)
class LabelRecord:
    """How hints and rewards were made.

    Attributes:
        planner_sha256: hash of the planner file.
        settings: :class:`ocplanner.guidance.settings.LabelSettings` as plain values.
        planner: what the planner says about itself.
        versions: installed packages at labelling.
        action_frame: frame of the actions that hints are in; None without hints, as the next three.
        action_scale: scale of the actions.
        ocp_hint: what the columns of ``obs/ocp_hint`` are, group by group.
        ocp_plan: what the numbers of each step of ``obs/ocp_plan`` are.
        source: the data set that was labelled.
        pictures: the data set whose images the planner saw, if that is another.
    """

    planner_sha256: str
    settings: Mapping[str, Any]
    planner: LabelledBy | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    action_frame: FrameName | None = None
    action_scale: ActionScale | None = None
    ocp_hint: tuple[str, ...] | None = None
    ocp_plan: tuple[str, ...] | None = None
    source: FileIdentity | None = None
    pictures: FileIdentity | None = None

    @classmethod
    def from_json(cls, text: str) -> "LabelRecord":
        """Read the attribute.

        Raises:
            ValueError: it is no JSON, or a value in it is missing or wrong; the message names it.
        """
        return build(cls, json.loads(text), ignore_unknown=True)

    def to_json(self) -> str:
        """Write the attribute, without what does not apply."""
        values = to_dict(self)
        present = {name: value for name, value in values.items() if value is not None or name == "pictures"}
        return json.dumps(present, sort_keys=True)
