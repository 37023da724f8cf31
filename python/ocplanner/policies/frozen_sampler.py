"""BCQ above a policy that BC trained before: what it takes over, and whether the data fit."""

from dataclasses import replace
from pathlib import Path

from ocplanner.errors import MismatchError
from ocplanner.files.records.policy import PolicyHeader
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import PolicyTraining, Preset, preset
from ocplanner.policies.evaluable import object_of
from ocplanner.policies.policy import Policy

_SAME = (
    "task",
    "robots",
    "low_dim",
    "actions",
    "action_frame",
    "action_scale",
    "action_range",
    "control_freq",
    "render",
)
"""What a data set must have in common with the one that the policy was trained on."""
_STEPS, _BATCH = 10_000, 100
"""Of the ``cpu`` preset: only critics learn, and from features that are computed once."""


def frozen_sampler_training(policy: Policy, name: Preset = "cpu") -> PolicyTraining:
    """Settings of critics that choose among a trained policy's actions; the policy itself stays as it is.

    Critics for several rewards can stand above one policy. They read the features that it sees, so each is trained in
    minutes, from images too.

    Args:
        policy: trained by BC, without a hint.
        name: preset that the critics' settings come from.

    Raises:
        MismatchError: the policy is of another algorithm, or reads a hint.
        UnknownNameError: no such preset.
    """
    training = policy.training
    if training.algorithm != "bc" or training.reads_hints:
        found = "reads hints" if training.algorithm == "bc" else f"was trained by {training.algorithm}"
        raise MismatchError(f"{policy.path} {found}; critics need one that bc trained without a hint")
    base = preset(name, "bcq", "image" if training.observation.cameras else "state")
    small = {"steps": _STEPS, "batch": _BATCH, "save_every": _STEPS // 10} if name == "cpu" else {}
    bcq = BCQConfig.of(base).proposing("policy", policy.sha256)
    return replace(base, observation=training.observation, network=training.network, algorithm_settings=bcq, **small)


def check_recorded(policy: Policy, header: PolicyHeader, data: Path) -> None:
    """Check that a data set is of the policy's task, arm, observations and actions.

    Args:
        policy: what proposes.
        header: what a policy trained on the data set says about it.
        data: its file.

    Raises:
        MismatchError: naming the first that is not so.
    """
    pairs = {key: (getattr(header, key), getattr(policy.header, key)) for key in _SAME}
    if "object" in policy.training.observation.low_dim:
        pairs["object"] = (object_of(header), object_of(policy.header))
    for key, (found, wanted) in pairs.items():
        if found != wanted and not (key == "render" and wanted is None):  # older files do not say what was measured
            raise MismatchError(
                f"{data}: its {key} is {found!r}, that of {policy.path} is {wanted!r}; "
                "give the data set that the policy was trained on, or a copy of it with rewards"
            )
