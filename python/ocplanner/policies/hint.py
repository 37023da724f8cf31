"""The plan as a hint for an actor (the paper's section 5.2 and Figure 9).

The action's mean in each mode is ``(x, y) * hint + A``: the policy predicts the weights x (position) and y (rotation)
and the residual A, which alone moves the gripper.
"""

import torch
from torch import Tensor, nn

from ocplanner.errors import ShapeError
from ocplanner.policies.config import HintConfig
from ocplanner.policies.gmm import Mixture


class HintWeights(nn.Module):
    """Predicts x and y for each mode and each k, and shifts a mixture's means by the weighted hint."""

    def __init__(self, features: int, modes: int, config: HintConfig) -> None:
        super().__init__()
        self.config, self.modes = config, modes
        self.linear = None if config.steers else nn.Linear(features, 2 * modes * len(config.horizons))

    def weights(self, features: Tensor) -> Tensor:
        """(..., M, K, 2): x and y of every mode and every k, from features (..., F)."""
        shape, first = (self.modes, len(self.config.horizons), 2), self.config.initial_weight
        if self.linear is None:
            return features.new_full((*features.shape[:-1], *shape), first)
        return self.linear(features).unflatten(-1, shape) + first

    def forward(self, residual: Mixture, features: Tensor, hint: Tensor) -> Mixture:
        """The mixture whose means are the weighted hint plus the residual's.

        Args:
            residual: mixture over actions (position 3, rotation 3, then the gripper) whose means are A.
            features: (..., F).
            hint: (..., 6 K + 1), see :data:`ocplanner.policies.config.HINT_KEY`; counts as zero where its flag is 0.

        Raises:
            ShapeError: the hint has another width.
        """
        means = self.residual(residual.means, hint)
        means = shifted(means, self.weights(features), displacements(hint, self.config))
        return Mixture(residual.logits, means, residual.stds)

    def residual(self, means: Tensor, hint: Tensor) -> Tensor:
        """A (..., M, A) as it counts: of the gripper alone where the hint steers."""
        if not self.config.steers:
            return means
        held = (hint[..., -1] > 0.5)[..., None, None]
        return torch.cat([means[..., :6].masked_fill(held, 0.0), means[..., 6:]], dim=-1)


def shifted(means: Tensor, weights: Tensor, moves: Tensor) -> Tensor:
    """(..., M, A) means of actions (position 3, rotation 3, then the gripper) plus the weighted hint.

    Args:
        means: (..., M, A), the residuals.
        weights: (..., M, K, 2), x and y.
        moves: (..., K, 2, 3), see :func:`displacements`.
    """
    # (..., M, K, 2, 1) * (..., 1, K, 2, 3), summed over k
    moved = (weights.unsqueeze(-1) * moves.unsqueeze(-4)).sum(dim=-3).flatten(-2)
    return nn.functional.pad(moved, (0, means.shape[-1] - 6)) + means


def residual_motion(residual: Mixture, hint: Tensor) -> Tensor:
    """Mean over all steps of |A|^2, action units: of the residual's motion in each mode by its probability, while held.

    Args:
        residual: mixture over actions (position 3, rotation 3, then the gripper) whose means are A.
        hint: (..., 6 K + 1); what is not held by its flag counts as 0.
    """
    squared = residual.means[..., :6].square().sum(dim=-1)
    return ((residual.logits.softmax(dim=-1) * squared).sum(dim=-1) * (hint[..., -1] > 0.5)).mean()


def displacements(hint: Tensor, config: HintConfig) -> Tensor:
    """(..., K, 2, 3) position and rotation of each k, zero where the flag is 0, from hints (..., 6 K + 1).

    Raises:
        ShapeError: the hint has another width.
    """
    if hint.shape[-1] != config.width:
        raise ShapeError(
            f"a hint of {hint.shape[-1]} numbers, expected {config.width} for horizons {config.horizons}; "
            "label the data set for the same horizons"
        )
    flag = hint[..., -1:] > 0.5
    moves = torch.where(flag, hint[..., :-1], torch.zeros_like(hint[..., :-1]))
    return moves.unflatten(-1, (len(config.horizons), 2, 3))
