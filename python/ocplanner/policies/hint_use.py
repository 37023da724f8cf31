"""What a policy makes of the plan: its weights x and y and its residual A along a recorded episode (section 5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import InvalidValueError, MismatchError
from ocplanner.files.records.labels import LabelRecord
from ocplanner.files.records.render import RenderRecord
from ocplanner.guidance.settings import LabelSettings
from ocplanner.policies.actor import Actor
from ocplanner.policies.config import HintConfig
from ocplanner.policies.data import load_samples
from ocplanner.policies.hint import displacements
from ocplanner.policies.network import PolicyNetwork
from ocplanner.policies.observation import Observation
from ocplanner.policies.policy import Policy


@dataclass(frozen=True)
class HintUse:
    """The most likely mode's mean, taken apart, at each of T steps: ``sum over k of (x, y)_k * hint_k + A``.

    Everything is in the unit of actions: 1 is the largest command.

    Attributes:
        demonstration: name of the episode.
        horizons: the K hint horizons, control steps.
        held: (T,) bool, the hint's flag; elsewhere the weights have nothing to weigh.
        hint: (T, K, 2, 3) float32, position and rotation part, zero where not held.
        weights: (T, K, 2) float32, x (position) and y (rotation).
        residual: (T, A) float32, position 3, rotation 3, then the gripper.
        probability: (T,) float32, of that mode.
    """

    demonstration: str
    horizons: tuple[int, ...]
    held: np.ndarray
    hint: np.ndarray
    weights: np.ndarray
    residual: np.ndarray
    probability: np.ndarray

    @property
    def moved(self) -> np.ndarray:
        """(T, 2, 3): what the weighted hint adds to position and rotation."""
        return (self.weights[..., None] * self.hint).sum(axis=1)

    @property
    def residual_size(self) -> np.ndarray:
        """(T, 2): length of A's position part and of its rotation part."""
        return np.linalg.norm(self.residual_parts, axis=-1)

    @property
    def share(self) -> np.ndarray:
        """(2,): how much of the motion along the mean action, position and rotation, comes from the hint while held.

        With the mean m and the weighted hint h this is sum(h . m) / sum(m . m); A makes up the rest to 1. NaN if the
        object is never held.
        """
        return mean_share([self])

    @property
    def residual_parts(self) -> np.ndarray:
        """(T, 2, 3): A's position part and its rotation part."""
        return self.residual[:, :6].reshape(-1, 2, 3)


def mean_share(uses: Sequence[HintUse]) -> np.ndarray:
    """(2,): :attr:`HintUse.share` of several episodes together."""
    moved = np.concatenate([use.moved[use.held] for use in uses])
    mean = moved + np.concatenate([use.residual_parts[use.held] for use in uses])
    from_hint, whole = (moved * mean).sum(axis=(0, 2)), (mean**2).sum(axis=(0, 2))
    return np.divide(from_hint, whole, out=np.full(2, np.nan), where=whole > 0)


def hint_use(policy: Policy, demos: Demonstrations, name: str) -> HintUse:
    """Show a policy a recorded episode of a labelled data set, and see what it would make of the hint.

    BC-RNN forgets at the same steps as in a rollout.

    Args:
        policy: a policy with a hint.
        demos: labelled as the policy's own data set was.
        name: of the demonstration.

    Raises:
        InvalidValueError: the policy reads no hint.
        MismatchError: the data set's hints or pictures are of another kind.
        DatasetError: there is no such demonstration, or it lacks an observation.
    """
    hint = check_fits(policy, demos)
    samples = load_samples(demos, [name], policy.training, policy.header.action_range)
    sequence = policy.training.sequence
    seen, _ = samples.batch(np.arange(0, len(samples), sequence or 1), policy.training, torch.device("cpu"), None)
    with torch.inference_mode():
        parts = _most_likely(policy.network, seen)
    if sequence is not None:  # (sequence, sequences, ...) to steps; the last sequence is padded
        parts = [part.transpose(0, 1).flatten(0, 1) for part in parts]
    weights, residual, probability, moves, flag = (part[: len(samples)].numpy() for part in parts)
    return HintUse(name, hint.horizons, flag, moves, weights, residual, probability)


def check_fits(policy: Policy, demos: Demonstrations) -> HintConfig:
    """Check that a data set has what the policy's own had, hints above all, and give the policy's hint.

    Raises:
        InvalidValueError: the policy reads no hint.
        MismatchError: the data set has no hints, hints of another kind, or pictures of another observation.
    """
    hint = policy.training.network.hint
    if hint is None:
        raise InvalidValueError(f"{policy.path} reads no hint, so there is nothing to see of one; give another policy")
    labels, own = demos.label_record, policy.header.labels
    found = None if labels is None else _kind(labels)
    wanted = None if own is None else _kind(own)
    if found != wanted:
        raise MismatchError(
            f"{demos.path} has {found or 'no hints on record'}, but {policy.path} learned from "
            f"{wanted or 'hints that `ocplanner label` did not make'}; give the data set that it was trained on"
        )
    shown, seen = demos.observe, (policy.header.render or RenderRecord()).observe
    if policy.training.observation.cameras and shown != seen:
        raise MismatchError(f"{demos.path} shows observe={shown}, but {policy.path} was trained on {seen}")
    return hint


def _kind(labels: LabelRecord) -> str:
    settings = LabelSettings.of(labels)
    steps = ", ".join(map(str, settings.horizon_steps))
    return f"hints {steps} steps ahead from the {settings.hint_from} by planner {labels.planner_sha256[:12]}"


def _most_likely(network: PolicyNetwork, seen: Observation) -> list[Tensor]:
    """Weights, residual and probability of the most likely mode; then the hint and its flag: each (..., as above)."""
    if not isinstance(network, Actor) or network.hint is None or seen.hint is None:
        raise MismatchError("the network reads no hint")
    features, _ = network.features(network.encode(seen), None)
    residual, weights = network.head(features), network.hint.weights(features)
    probability, mode = residual.logits.softmax(dim=-1).max(dim=-1)
    return [
        weights.take_along_dim(mode[..., None, None, None], dim=-3).squeeze(-3),
        network.hint.residual(residual.means, seen.hint).take_along_dim(mode[..., None, None], dim=-2).squeeze(-2),
        probability,
        displacements(seen.hint, network.hint.config),
        seen.hint[..., -1] > 0.5,
    ]
