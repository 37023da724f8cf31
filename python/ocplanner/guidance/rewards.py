"""From plans to rewards: how far the object went from where it was planned (the paper's section 5)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ocplanner import _core
from ocplanner.settings import require

Form = Literal["penalty", "literal", "exp", "potential"]
ObjectPoses: TypeAlias = tuple[np.ndarray, np.ndarray | None]
"""Positions (T, 3) float64 in m and rotations (T, 3, 3) float64, object -> world, or None."""


class FurtherTerm(NamedTuple):
    """A term of E beside the paper's position and rotation.

    Attributes:
        weight: field of :class:`RewardConfig` that holds its weight; give it the default 0.
        error: planned and achieved poses -> (T,) float64, unweighted.
    """

    weight: str
    error: Callable[[ObjectPoses, ObjectPoses], np.ndarray]


FURTHER_TERMS: dict[str, FurtherTerm] = {}
"""Terms by name. To add one, write its function and its weight in this file and name it here: ``ocplanner label`` then
has its flag and writes it as ``ocp_reward_<name>``, and live rewards report it under that name."""


@dataclass(frozen=True)
class RewardConfig:
    """How the weighted error E = a |p' - p|^2 + b |r' - r|^2 of a transition becomes its reward.

    ``literal`` rewards leaving the plan. ``exp`` is 1 on the plan. ``potential`` is gamma Phi(s') - Phi(s) with
    Phi = -E, which leaves the best policy unchanged (Ng, Harada and Russell 1999).

    The default ``scale`` is the E of 2 cm and 0.2 rad together under the default weights, which count 0.2 rad 200 times
    as much as 2 cm. For an even share use, for instance, ``a=1 / 0.02**2, b=1 / 0.2**2, scale=1``.

    Raises:
        InvalidValueError: a weight is negative, or the form's ``scale`` or ``gamma`` is outside its range.
        UnknownNameError: no such form; the message lists the known ones.
    """

    a: float = 0.003
    """Weight of the position term, 1/m^2."""
    b: float = 0.003
    """Weight of the rotation term."""
    form: Form = "penalty"
    """penalty: -E. literal: +E, as the paper prints it. exp: exp(-E / scale). potential: shaping by Phi = -E."""
    gamma: float = 0.99
    """The learner's discount, in [0, 1]; for the form potential only."""
    scale: float = 2.5e-4
    """The weighted error E at which the form exp has fallen to 1/e."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        _ = self.law
        for name, term in FURTHER_TERMS.items():
            weight = getattr(self, term.weight)
            require(weight >= 0, f"the weight of the reward term {name} is {weight}, but must not be negative")

    @property
    def law(self) -> _core.RewardLaw:
        """The native reward of this configuration."""
        return _core.RewardLaw(
            self.form, weight_position=self.a, weight_rotation=self.b, scale=self.scale, gamma=self.gamma
        )


DEFAULT_REWARD = RewardConfig()


class Rewards(NamedTuple):
    """Terms and rewards of an episode's T transitions.

    Attributes:
        position: (T,) float64, |p' - p|^2 in m^2, unweighted; 0 without a grasp.
        rotation: (T,) float64, |r' - r|^2, unweighted; 0 without a grasp. None if the plan has no rotations.
        reward: (T,) float64.
        further: (T,) float64 by name, unweighted: :data:`FURTHER_TERMS`; 0 without a grasp.
    """

    position: np.ndarray
    rotation: np.ndarray | None
    reward: np.ndarray
    further: Mapping[str, np.ndarray] = {}

    @property
    def last(self) -> "Rewards":
        """Terms and reward, each (1,), of the last transition."""
        rotation = None if self.rotation is None else self.rotation[-1:]
        further = {name: term[-1:] for name, term in self.further.items()}
        return Rewards(self.position[-1:], rotation, self.reward[-1:], further)

    @property
    def terms(self) -> dict[str, np.ndarray]:
        """Every unweighted term that there is, by the name it is stored under, ``ocp_reward_<term>``."""
        own = {"position": self.position} | ({} if self.rotation is None else {"rotation": self.rotation})
        return {f"ocp_reward_{name}": term for name, term in {**own, **self.further}.items()}


def plan_reward(
    planned: ObjectPoses,
    achieved: ObjectPoses,
    grasping: NDArray[np.bool_],
    config: RewardConfig = DEFAULT_REWARD,
    *,
    terminal: bool = True,
) -> Rewards:
    """Reward every transition by the distance between the planned and the achieved pose of the object.

    The rotation term compares rotations as the paper writes them: the six numbers of the first two columns of the
    matrix. For rotations an angle theta apart about the axis n, in the object's frame, it is
    2 (1 - cos theta)(1 + n_z^2). Without a grasp, terms and rewards are 0, since the plan then says nothing about what
    the robot does.

    With ``form="potential"`` the potential of a state is -E of the transition that led to it; it is 0 in the first
    state, after a transition without a grasp, and in a terminal state. So a grasp begins with -gamma E, and the first
    transition after it pays the last E back. Over an episode that ends in a terminal state the discounted rewards sum
    to 0, otherwise to gamma^T Phi(s_T).

    Args:
        planned: for each transition from t to t + 1 the plan made at t, m'_{t+1}: positions (T, 3) float64 in m and
            rotations (T, 3, 3) float64, object -> world, or None from a planner of positions.
        achieved: where the object is afterwards, m_{t+1}, likewise; its rotations are ignored where none are planned.
        grasping: (T,) bool, whether the robot holds the object during the transition.
        config: weights and form.
        terminal: the last transition ends the episode for good, not by a time limit; only ``potential`` asks.

    Raises:
        InvalidValueError: a number is not finite, grasp or not, a matrix is no rotation, or a reward overflows.
        ShapeError: wrong shape or dtype, or lengths that differ.
    """
    planned, achieved = _rows(planned), _rows(achieved)
    if not FURTHER_TERMS:
        return Rewards(*config.law.rewards(planned, achieved, grasping, terminal=terminal))
    errors = {name: np.where(grasping, term.error(planned, achieved), 0.0) for name, term in FURTHER_TERMS.items()}
    further = np.sum([getattr(config, FURTHER_TERMS[name].weight) * error for name, error in errors.items()], axis=0)
    found = config.law.rewards(planned, achieved, grasping, further=further, terminal=terminal)
    return Rewards(*found, errors)


def _rows(poses: ObjectPoses) -> ObjectPoses:
    """C-contiguous arrays: the first step of a batch of plans, ``plan.position[:, 0]``, is not."""
    position, rotation = poses
    return np.ascontiguousarray(position), None if rotation is None else np.ascontiguousarray(rotation)
