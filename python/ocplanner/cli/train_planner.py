"""The verb ``train-planner``."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, get_args

import tyro

from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.files.records.planner import EncoderType
from ocplanner.planner.config import PlannerTraining, Preset, preset

_CPU = preset("cpu")


@dataclass(frozen=True)
class TrainPlanner:
    """Train an object-centric planner on a rendered data set; run the same command again to continue after a stop."""

    data: Path
    """HDF5 with images, made by `ocplanner render`."""
    run_folder: Annotated[Path, tyro.conf.arg(name="run")]
    """Run folder: config.yaml, metrics.jsonl, TensorBoard events, checkpoints and planner.safetensors."""
    training: Annotated[PlannerTraining, tyro.conf.arg(name="")] = _CPU
    """Settings of the training; what is not given is the preset's."""
    reading: Annotated[ReadSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_READING

    @classmethod
    def defaults(cls, arguments: Sequence[str]) -> "TrainPlanner":
        """The settings of the preset and of the encoder that the arguments name."""
        parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
        parser.add_argument("--preset", choices=get_args(Preset), default="cpu")
        parser.add_argument("--encoder", choices=get_args(EncoderType))
        try:
            chosen = parser.parse_known_args(arguments)[0]
        except argparse.ArgumentError:  # the command's own parser will say what is wrong
            chosen = parser.parse_args([])
        return cls(tyro.MISSING, tyro.MISSING, preset(chosen.preset, chosen.encoder))

    def run(self) -> None:
        """Train, draw the curves into the run folder's report, and print the planner file's path."""
        from ocplanner.planner.train import train_planner
        from ocplanner.report.page import write_report

        planner = train_planner(self.training, self.data, self.run_folder, self.reading)
        write_report([self.run_folder], self.run_folder / "report.html")
        sys.stdout.write(f"{planner}\n")


COMMAND = TrainPlanner
