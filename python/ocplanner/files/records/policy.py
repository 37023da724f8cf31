"""The header of a policy file: everything that it says about itself beside its weights."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ocplanner.errors import ModelFileError
from ocplanner.files.records.labels import ActionScale, FrameName, LabelRecord
from ocplanner.files.records.render import RenderRecord
from ocplanner.settings import build, require, to_dict

POLICY_FORMAT = 2
"""Format 1 differs only inside ``training``: it keeps the settings of BCQ under ``bcq``."""


@dataclass(frozen=True, kw_only=True)
class PolicyHeader:
    """What a policy file says about itself.

    Attributes:
        task: our name of the task, such as ``Square``.
        environment: robosuite's name of it; None in files that do not say.
        robots: robots of the demonstrations.
        object_layout: the robosuite that recorded ``object``: up to 1.4.1 (``absolute-first``) or from 1.5
            (``relative-first``); None if the policy does not read it, or in some files that do not say.
        object_sensors: the sensors that ``object`` consists of, see :mod:`ocplanner.demos.object_sensors`; None if the
            policy does not read it, and in files that do not say: then ``object_layout`` counts.
        action_frame: frame of the recorded actions; None where they are no end-effector deltas of one arm.
        action_scale: their scale; None without a frame.
        action_range: (least, most) of each number of the recorded actions, where a policy learns them scaled to
            [-1, 1]; None where it learns them as they are.
        control_freq: control steps a second of the recording, Hz; 20 in files that do not say.
        render: how the images were drawn; None if the data set does not say.
        labels: how the hints were made, if the policy reads any and ``ocplanner label`` made them.
        rewards: how the rewards were made, if the policy learned from any and ``ocplanner label`` made them.
        low_dim: width of the low-dimensional observation.
        actions: width of an action.
        algorithm: that trained it.
        seed: of the training.
        step: training steps done.
        training: the whole configuration, :class:`ocplanner.policies.config.PolicyTraining` as plain values.
        data: digest of the training data.
        versions: installed packages at training.
        exported_from: the checkpoint of robomimic that the policy was exported from, or None.
    """

    task: str
    environment: str | None = None
    robots: tuple[str, ...]
    object_layout: Literal["absolute-first", "relative-first"] | None
    object_sensors: tuple[str, ...] | None = None
    action_frame: FrameName | None
    action_scale: ActionScale | None
    action_range: tuple[tuple[float, float], ...] | None = None
    control_freq: float = 20.0
    render: RenderRecord | None
    labels: LabelRecord | None
    rewards: LabelRecord | None = None
    low_dim: int
    actions: int
    algorithm: str
    seed: int
    step: int
    training: Mapping[str, Any]
    data: str | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    exported_from: str | None = None

    def __post_init__(self) -> None:
        """Check the numbers, and that frame and scale of the actions belong together."""
        require(0 < self.control_freq < float("inf"), f"control_freq is {self.control_freq!r}, expected Hz above 0")
        ranges = self.action_range
        fits = ranges is None or (len(ranges) == self.actions and all(least < most for least, most in ranges))
        require(fits, f"action_range {ranges} does not give least < most for each of {self.actions} numbers")
        for name, least in (("low_dim", 0), ("actions", 1), ("step", 0)):
            require(getattr(self, name) >= least, f"{name} is {getattr(self, name)}, but must be at least {least}")
        scaled = (self.action_frame is None) == (self.action_scale is None)
        require(scaled, f"action_frame is {self.action_frame!r}, but action_scale is {self.action_scale!r}")

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> "PolicyHeader":
        """Read the header from the metadata of a policy's safetensors file.

        Raises:
            ModelFileError: it is not that of a policy, or of a newer format, or a field is missing or wrong.
        """
        try:
            found = json.loads(metadata["ocplanner"])
            kind, number, config = found["kind"], found["format"], found["config"]
        except (KeyError, TypeError, ValueError) as error:
            raise ModelFileError("it has no header of ocplanner's") from error
        if kind != "policy":
            raise ModelFileError(f"it holds a {kind}")
        if number not in range(1, POLICY_FORMAT + 1):
            raise ModelFileError(
                f"it has format {number!r}, and this version reads 1 to {POLICY_FORMAT}: update ocplanner"
            )
        try:
            return build(cls, config, ignore_unknown=True)
        except ValueError as error:
            raise ModelFileError(f"its header cannot be read: {error}") from error

    def metadata(self) -> dict[str, str]:
        """The metadata of the policy's safetensors file."""
        return {"ocplanner": json.dumps({"format": POLICY_FORMAT, "kind": "policy", "config": to_dict(self)})}
