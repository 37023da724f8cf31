"""The verb ``train-policy``."""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.errors import InvalidValueError
from ocplanner.policies.algorithms import ALGORITHMS, Algorithm, find_algorithm
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import HintConfig, ObservationKind, PolicyTraining, preset
from ocplanner.settings import require

if TYPE_CHECKING:
    from ocplanner.policies.robomimic_config import RobomimicConfig


@dataclass(frozen=True, kw_only=True)
class TrainPolicy:
    """Train a policy from recordings; run the same command again to continue after a stop."""

    run_folder: Annotated[Path, tyro.conf.arg(name="run")]
    """Run folder: config.yaml, metrics.jsonl, TensorBoard events, checkpoints, policies/ and policy.safetensors."""
    data: Path | None = None
    """Robomimic HDF5; `ocplanner label` adds hints, `ocplanner render` images. Default: the one that --config names."""
    config: Path | None = None
    """Robomimic JSON configuration (algo_name: bc) in place of a preset; other flags override it."""
    observations: ObservationKind | None = None
    """state (the default): numbers with the object's pose. image: cameras and proprioception."""
    sampler_from: Path | None = None
    """Policy file or run folder of bc that proposes to bcq's critics and stays as it is; what is seen and the networks
    are that policy's. Only critics are trained, in minutes, so several rewards can be tried above one policy."""
    hint: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Read the plan as a hint from obs/ocp_hint, with the horizons that the data set was labelled with."""
    training: Annotated[PolicyTraining, tyro.conf.arg(name=""), tyro.conf.AvoidSubcommands]
    """Settings of the training; what is not given is that of the preset, configuration or policy."""
    reading: Annotated[ReadSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_READING
    processes: int = 1
    """Training processes on this machine; under torchrun those that it started."""

    @classmethod
    def defaults(cls, arguments: Sequence[str]) -> "TrainPolicy":
        """The flags' defaults: the settings of the preset, configuration or policy that ``arguments`` name.

        Raises:
            InvalidValueError: flags contradict each other, or the configuration cannot be honoured.
            UnknownNameError: there is no such algorithm, preset or kind of observation.
            ModelFileError: the policy of --sampler-from cannot be read.
            MismatchError: it cannot propose actions to critics.
        """
        chosen, flags = _chosen(arguments)
        training = _training(chosen)
        algorithm, network = find_algorithm(training.algorithm), training.network
        of_hint = [flag for flag in flags if flag.startswith("--hint-")]
        unread = bool(of_hint) and not chosen.hint and network.hint is None
        require(not unread, f"{', '.join(of_hint)}: no hint is read; give --hint too")
        for name in ALGORITHMS:
            given = sorted((_flags(find_algorithm(name)) - _flags(algorithm)).intersection(flags))
            require(not given, f"{', '.join(given)}: for --algorithm {name} alone")
        if algorithm.hints and network.hint is None:
            training = replace(training, network=replace(network, hint=HintConfig()))
        return cls(run_folder=tyro.MISSING, training=training)

    def configuration(self) -> PolicyTraining:
        """The settings that the flags amount to: a hint only where --hint or --config asks for one.

        Raises:
            InvalidValueError: the algorithm reads no hint.
        """
        given = self._robomimic()
        hinted = self.hint or (given is not None and given.training.network.hint is not None)
        hint = (self.training.network.hint or HintConfig()) if hinted else None
        mask = None if self.training.mask == "all" else self.training.mask
        return replace(self.training, mask=mask, network=replace(self.training.network, hint=hint))

    def run(self) -> None:
        """Train, and print the policy file's path.

        Raises:
            InvalidValueError: the configuration cannot be honoured, flags contradict each other, or no file is named.
        """
        from ocplanner.policies.train import train_policy

        given, first = self._robomimic(), os.environ.get("RANK", "0") == "0"  # torchrun runs this in every process
        if given is not None and given.ignored and first:
            sys.stderr.write(f"{self.config}: without effect on the training: {', '.join(given.ignored)}\n")
        data = self.data or (None if given is None else given.data)
        if data is None:
            raise InvalidValueError("no data set is named; give --data")
        policy = train_policy(
            self.configuration(), data, self.run_folder, self.processes, self.sampler_from, self.reading
        )
        if first:
            sys.stdout.write(f"{policy}\n")

    def _robomimic(self) -> "RobomimicConfig | None":
        if self.config is None:
            return None
        from ocplanner.policies.robomimic_config import read_robomimic_config

        return read_robomimic_config(self.config)


def _flags(algorithm: Algorithm) -> set[str]:
    """The flags that only this algorithm has."""
    return {f"--{field.name.replace('_', '-')}" for field in fields(algorithm.settings)}


def _chosen(arguments: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """What decides the defaults, and the names of all flags."""
    names = [argument.partition("=") for argument in arguments]
    plain = [(name.replace("_", "-") if name.startswith("--") else name) + mark + value for name, mark, value in names]
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    for name in ("algorithm", "preset", "observations", "sampler"):
        parser.add_argument(f"--{name}")
    for name in ("config", "sampler-from"):
        parser.add_argument(f"--{name}", type=Path)
    parser.add_argument("--hint", action="store_true")
    try:
        chosen = parser.parse_known_args(plain)[0]
    except argparse.ArgumentError:  # the command's own parser says what is wrong
        chosen = parser.parse_args([])
    return chosen, [argument.partition("=")[0] for argument in plain if argument.startswith("--")]


def _training(chosen: argparse.Namespace) -> PolicyTraining:
    if chosen.config is not None:
        from ocplanner.policies.robomimic_config import read_robomimic_config

        for flag in ("algorithm", "preset", "observations", "sampler_from"):
            plain = flag.replace("_", "-")
            require(getattr(chosen, flag) is None, f"--{plain} and --config both decide the network; give one of them")
        return read_robomimic_config(chosen.config).training
    if chosen.sampler_from is not None:
        from ocplanner.policies.frozen_sampler import frozen_sampler_training
        from ocplanner.policies.policy import Policy

        for flag in ("observations", "sampler"):
            require(getattr(chosen, flag) is None, f"--{flag} and --sampler-from both decide the network; drop one")
        require(chosen.algorithm == "bcq", "--sampler-from is for --algorithm bcq alone")
        return frozen_sampler_training(Policy.load(chosen.sampler_from), chosen.preset or "cpu")
    training = preset(chosen.preset or "cpu", chosen.algorithm or "bc", chosen.observations or "state")
    own = training.algorithm_settings
    if isinstance(own, BCQConfig) and chosen.sampler in ("vae", "gmm"):
        return replace(training, algorithm_settings=own.proposing(chosen.sampler))
    return training


COMMAND = TrainPolicy
