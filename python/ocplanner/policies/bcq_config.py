"""Settings that only batch-constrained Q-learning has."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from tyro.conf import Fixed, Suppress

from ocplanner.policies.algorithms import AlgorithmSettings
from ocplanner.settings import require, require_choice

if TYPE_CHECKING:
    from ocplanner.policies.config import PolicyTraining

Sampler = Literal["vae", "gmm", "policy"]


@dataclass(frozen=True)
class BCQConfig(AlgorithmSettings):
    """A sampler that proposes actions, and critics that choose among them. Defaults: robomimic's from states."""

    critic_hidden: tuple[int, ...] = (300, 400)
    """Widths of a critic's layers."""
    critic_learning_rate: float = 1e-4
    """Before any schedule; the sampler learns with --learning-rate."""
    critics: int = 2
    """Critics, which learn side by side."""
    pessimism: float = 0.75
    """Weight of the critics' least value in the target; their greatest has the rest."""
    discount: float = 0.99
    """Of the next state's value."""
    tau: float = 5e-4
    """How far the target critics move toward the critics in a step."""
    proposals: int = 10
    """Actions that the target's maximum is taken over."""
    rollout_proposals: int = 100
    """Actions that a rollout's step chooses from."""
    vae_hidden: tuple[int, ...] = (300, 400)
    """Widths of the VAE's encoder, and of its decoder."""
    latent: int = 14
    """Width of the VAE's latent."""
    kl_weight: float = 0.05
    """Of the VAE: the smaller, the more its proposals differ."""
    sampler: Sampler = "vae"
    """What proposes actions to the critics. gmm: a mixture as bc has it, robomimic's BCQ_GMM. policy: a policy that bc
    trained before and that stays as it is, see --sampler-from; the critics read the features that it sees."""
    sampler_sha256: Suppress[Fixed[str | None]] = None
    """Hash of that policy's file; None for the others."""

    @staticmethod
    def of(training: "PolicyTraining") -> "BCQConfig":
        """The settings of BCQ in those of a training.

        Raises:
            InvalidValueError: the training is of another algorithm.
        """
        settings = training.algorithm_settings
        require(isinstance(settings, BCQConfig), f"{training.algorithm} has no critics; train with bcq")
        return settings  # type: ignore[return-value]

    def proposing(self, sampler: Sampler, sha256: str | None = None) -> "BCQConfig":
        """The same with this sampler, if it is a trained policy the one whose file has this hash.

        From a mixture a rollout chooses among as few actions as a target: among a hundred there is one of every mode,
        however improbable, and critics overvalue what they have not seen.
        """
        chosen = self.rollout_proposals if sampler == "vae" else self.proposals
        return replace(self, sampler=sampler, sampler_sha256=sha256, rollout_proposals=chosen)

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("sampler", self.sampler, Sampler)
        named = self.sampler_sha256 is not None
        together = named == (self.sampler == "policy")
        require(together, "the sampler policy and the hash of its file belong together: give --sampler-from")
        counts = (*self.critic_hidden, *self.vae_hidden, self.critics, self.proposals, self.rollout_proposals)
        require(min(*counts, self.latent) >= 1, "layer widths, critics, proposals and latent must be at least 1")
        require(self.critic_learning_rate > 0, f"critic learning rate {self.critic_learning_rate} must be positive")
        require(0 <= self.pessimism <= 1, f"pessimism {self.pessimism} must lie in [0, 1]")
        require(0 <= self.discount < 1, f"discount {self.discount} must lie in [0, 1)")
        require(0 < self.tau <= 1, f"tau {self.tau} must lie in (0, 1]")
        require(self.kl_weight >= 0, f"KL weight {self.kl_weight} must not be negative")
        unused = self.sampler != "vae" and self.kl_weight != BCQConfig.kl_weight
        require(not unused, "--kl-weight is for --algorithm bcq with --sampler vae alone")
