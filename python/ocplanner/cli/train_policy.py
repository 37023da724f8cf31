"""The verb ``train-policy``."""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ocplanner.errors import InvalidValueError
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import (
    HintConfig,
    ObservationKind,
    PolicyTraining,
    Precision,
    Preset,
    preset,
)
from ocplanner.settings import require

if TYPE_CHECKING:
    from ocplanner.policies.robomimic_config import RobomimicConfig

_Switch = Annotated[bool, tyro.conf.FlagCreatePairsOff]
"""A flag that switches on; a --no-... could not switch off what --config switches on."""


@dataclass(frozen=True)
class TrainPolicy:
    """Train a policy from recordings; run the same command again to continue after a stop."""

    run_folder: Annotated[Path, tyro.conf.arg(name="run")]
    """Run folder: config.yaml, metrics.jsonl, TensorBoard events, checkpoints, policies/ and policy.safetensors."""
    data: Path | None = None
    """Robomimic HDF5; `ocplanner label` adds hints, `ocplanner render` images. Default: the one that --config names."""
    config: Path | None = None
    """Robomimic JSON configuration (algo_name: bc) in place of a preset; other flags override it."""
    algorithm: Literal["bc", "bc-rnn", "bcq"] | None = None
    """bc (the default): the last observation decides. bc-rnn: an LSTM remembers. bcq: learns from rewards, which
    `ocplanner label --reward` makes dense."""
    preset: Preset | None = None
    """cpu (the default): small networks, under an hour on one or two cores. robomimic: published hyperparameters."""
    observations: ObservationKind | None = None
    """state (the default): numbers with the object's pose. image: cameras and proprioception."""
    hint: _Switch = False
    """Read the plan as a hint from obs/ocp_hint."""
    hint_horizons: tuple[int, ...] | None = None
    """How many steps ahead the hints look, as the data set was labelled. Default: 1."""
    hint_residual_penalty: float | None = None
    """Weight in the loss of the squared residual motion while the object is held. Default: 0."""
    hint_weight: float | None = None
    """What x and y start from. Default: 1."""
    hint_steers: _Switch = False
    """While the object is held the hint alone moves it, by the weight --hint-weight; the policy moves the gripper."""
    hint_instead_of_pictures: _Switch = False
    """While the object is held the policy sees the plan in place of the cameras' pictures."""
    low_dim: tuple[str, ...] | None = None
    """Names of the low-dimensional observations instead of the preset's."""
    cameras: tuple[str, ...] | None = None
    """Cameras instead of the preset's."""
    mask: str | None = None
    """Train on mask/NAME of the data set (default: train); `all`: on every demonstration."""
    seed: int | None = None
    """Decides initial weights, batches and crops. Default: 0."""
    steps: int | None = None
    """Training steps instead of the preset's."""
    batch: int | None = None
    """Samples or sequences a step instead of the preset's, over all processes together."""
    learning_rate: float | None = None
    """Instead of the preset's; of bcq its sampler's."""
    sampler: Literal["vae", "gmm"] | None = None
    """What proposes actions to bcq's critics. vae (the default), or gmm: a mixture as bc has it."""
    sampler_from: Path | None = None
    """Policy file or run folder of bc that proposes to bcq's critics and stays as it is; what is seen and the networks
    are that policy's. Only critics are trained, in minutes, so several rewards can be tried above one policy."""
    kl_weight: float | None = None
    """Of bcq's action VAE instead of the preset's: the smaller, the more its proposals differ."""
    ema: float | None = None
    """Decay of the averaged weights that become the policy instead of the preset's; 0: off."""
    save_every: int | None = None
    """Steps between the policies kept for evaluation, instead of the preset's."""
    processes: int = 1
    """Training processes on this machine; under torchrun those that it started."""
    threads: int = 1
    """CPU threads of each process."""
    device: str | None = None
    """cpu (the default), cuda or mps."""
    precision: Precision | None = None
    """float32 (the default), or bfloat16 for the products inside layers: faster on processors that have it."""

    def configuration(self) -> PolicyTraining:
        """The preset, or the robomimic configuration, with these flags applied.

        Raises:
            InvalidValueError: the configuration cannot be honoured, or flags contradict each other.
        """
        return self._resolved(self._robomimic())

    def run(self) -> None:
        """Train, and print the policy file's path.

        Raises:
            InvalidValueError: the configuration cannot be honoured, flags contradict each other, or no file is named.
        """
        from ocplanner.policies.train import train_policy

        given = self._robomimic()
        first = os.environ.get("RANK", "0") == "0"  # torchrun runs this in every process
        if given is not None and given.ignored and first:
            sys.stderr.write(f"{self.config}: without effect on the training: {', '.join(given.ignored)}\n")
        data = self.data or (given.data if given is not None else None)
        if data is None:
            raise InvalidValueError("no data set is named; give --data")
        policy = train_policy(self._resolved(given), data, self.run_folder, self.processes, self.sampler_from)
        if first:
            sys.stdout.write(f"{policy}\n")

    def _robomimic(self) -> "RobomimicConfig | None":
        if self.sampler_from is not None:
            for flag in ("config", "observations", "low_dim", "cameras", "sampler", "kl_weight"):
                plain = flag.replace("_", "-")
                require(getattr(self, flag) is None, f"--{plain} and --sampler-from both decide the network; drop one")
            require(self.algorithm == "bcq", "--sampler-from is for --algorithm bcq alone")
        if self.config is None:
            return None
        from ocplanner.policies.robomimic_config import read_robomimic_config

        for flag in ("algorithm", "preset", "observations"):
            require(getattr(self, flag) is None, f"--{flag} and --config both decide the network; give one of them")
        return read_robomimic_config(self.config)

    def _resolved(self, given: "RobomimicConfig | None") -> PolicyTraining:
        base = given.training if given is not None else self._preset()
        names = ("steps", "batch", "learning_rate", "ema", "save_every", "seed", "device", "precision")
        flags = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if self.mask is not None:
            flags["mask"] = None if self.mask == "all" else self.mask
        seen, network, bcq = base.observation, base.network, base.algorithm_settings
        if self.sampler is not None:
            require(isinstance(bcq, BCQConfig), "--sampler is for --algorithm bcq alone")
            flags["algorithm_settings"] = bcq = BCQConfig.of(base).proposing(self.sampler)
        if self.kl_weight is not None:
            vae = isinstance(bcq, BCQConfig) and bcq.sampler == "vae"
            require(vae, "--kl-weight is for --algorithm bcq with --sampler vae alone")
            flags["algorithm_settings"] = replace(bcq, kl_weight=self.kl_weight)  # type: ignore[call-arg]
        return replace(
            base,
            observation=replace(
                seen,
                low_dim=seen.low_dim if self.low_dim is None else self.low_dim,
                cameras=seen.cameras if self.cameras is None else self.cameras,
            ),
            network=replace(network, hint=self._hint(network.hint)),
            threads=self.threads,
            **flags,
        )

    def _preset(self) -> PolicyTraining:
        if self.sampler_from is not None:
            from ocplanner.policies.frozen_sampler import frozen_sampler_training
            from ocplanner.policies.policy import Policy

            return frozen_sampler_training(Policy.load(self.sampler_from), self.preset or "cpu")
        return preset(self.preset or "cpu", self.algorithm or "bc", self.observations or "state")

    def _hint(self, base: HintConfig | None) -> HintConfig | None:
        settings = {
            "hint_horizons": ("horizons", self.hint_horizons),
            "hint_residual_penalty": ("residual_penalty", self.hint_residual_penalty),
            "hint_weight": ("initial_weight", self.hint_weight),
            "hint_steers": ("steers", self.hint_steers or None),
            "hint_instead_of_pictures": ("instead_of_pictures", self.hint_instead_of_pictures or None),
        }
        given = {flag: setting for flag, setting in settings.items() if setting[1] is not None}
        hint = base or (HintConfig() if self.hint else None)
        if hint is None:
            flags = ", ".join(f"--{flag.replace('_', '-')}" for flag in given)
            require(not given, f"{flags}: no hint is read; give --hint too")
            return None
        return replace(hint, **dict(given.values()))


COMMAND = TrainPolicy
