"""The verb ``train-policy``."""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from ocplanner.policies.config import (
    Algorithm,
    HintConfig,
    ObservationKind,
    PolicyTraining,
    Preset,
    preset,
)


@dataclass(frozen=True)
class TrainPolicy:
    """Train a policy by imitation; run the same command again to continue after a stop."""

    data: Path
    """Robomimic HDF5; `ocplanner label` adds hints, `ocplanner render` images."""
    run_folder: Annotated[Path, tyro.conf.arg(name="run")]
    """Run folder: config.yaml, metrics.jsonl, TensorBoard events, checkpoints, policies/ and policy.safetensors."""
    algorithm: Algorithm = "bc"
    """bc: the last observation decides. bc-rnn: an LSTM remembers."""
    preset: Preset = "cpu"
    """cpu: small networks, under an hour on one or two cores. robomimic: the published hyperparameters."""
    observations: ObservationKind = "state"
    """state: numbers with the object's pose. image: cameras and proprioception."""
    hint: bool = False
    """Read the plan as a hint from obs/ocp_hint."""
    hint_horizons: tuple[int, ...] = (1,)
    """How many steps ahead the hints look, as the data set was labelled."""
    low_dim: tuple[str, ...] | None = None
    """Names of the low-dimensional observations instead of the preset's."""
    cameras: tuple[str, ...] | None = None
    """Cameras instead of the preset's."""
    mask: str = "train"
    """Train on mask/NAME of the data set; `all`: on every demonstration."""
    seed: int = 0
    """Decides initial weights, batches and crops."""
    steps: int | None = None
    """Training steps instead of the preset's."""
    batch: int | None = None
    """Samples or sequences a step instead of the preset's, over all processes together."""
    learning_rate: float | None = None
    """Instead of the preset's."""
    ema: float | None = None
    """Decay of the averaged weights that become the policy instead of the preset's; 0: off."""
    save_every: int | None = None
    """Steps between the policies kept for evaluation, instead of the preset's."""
    processes: int = 1
    """Training processes on this machine; under torchrun those that it started."""
    threads: int = 1
    """CPU threads of each process."""
    device: str = "cpu"
    """cpu, cuda or mps."""

    def configuration(self) -> PolicyTraining:
        """The preset with these flags applied."""
        base = preset(self.preset, self.algorithm, self.observations)
        seen = base.observation
        seen = replace(
            seen,
            low_dim=seen.low_dim if self.low_dim is None else self.low_dim,
            cameras=seen.cameras if self.cameras is None else self.cameras,
        )
        names = ("steps", "batch", "learning_rate", "ema", "save_every")
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return replace(
            base,
            observation=seen,
            network=replace(base.network, hint=HintConfig(self.hint_horizons) if self.hint else None),
            mask=None if self.mask == "all" else self.mask,
            seed=self.seed,
            threads=self.threads,
            device=self.device,
            **given,
        )

    def run(self) -> None:
        """Train, and print the policy file's path."""
        from ocplanner.policies.train import train_policy

        policy = train_policy(self.configuration(), self.data, self.run_folder, self.processes)
        if os.environ.get("RANK", "0") == "0":  # torchrun runs this in every process
            sys.stdout.write(f"{policy}\n")


COMMAND = TrainPolicy
