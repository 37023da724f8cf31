"""The folder of one training: configuration, metrics, TensorBoard events and checkpoints; a kill damages none."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from ocplanner.errors import ResultFileError, TrainingError
from ocplanner.files.records.metrics import (
    CONFIG,
    METRICS,
    MetricsRow,
    RunConfig,
    StepMetrics,
    append_metrics,
    read_config,
    read_metrics,
    write_config,
    write_metrics,
)
from ocplanner.files.storage import atomic_write, check_folder, writing

_FREE = ("threads", "device")
"""Settings that may change when a training is resumed."""


_WRITTEN = (METRICS, "checkpoints/latest.safetensors", "planner.safetensors", "policy.safetensors", "policies")
"""What would be lost if the folder of something else were trained in."""


def check_run_folder(path: Path, reads: Iterable[str | Path | None] = ()) -> None:
    """Check that a training may use a folder, before anything is read or made.

    Raises:
        OutputError: it is or holds the working directory, holds a file that is read, or is no run folder.
    """
    check_folder(path, _WRITTEN, CONFIG, reads)


class RunFolder:
    """Reads and writes the run folder of a planner or a policy (:mod:`ocplanner.files.records.metrics`)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with writing(path):
            (path / "checkpoints").mkdir(parents=True, exist_ok=True)
        self._board: SummaryWriter | None = None

    def claim(self, config: RunConfig) -> None:
        """Write ``config.yaml``, or check that it holds the same settings; without a checkpoint, delete the metrics.

        Raises:
            TrainingError: the file is damaged, or the folder belongs to a training with other settings or data.
        """
        path = self.path / CONFIG
        if path.exists():
            try:
                found = read_config(path)
            except ResultFileError as error:
                raise TrainingError(str(error)) from error
            changed = _differences(found.to_yaml(), config.to_yaml())
            if changed:
                raise TrainingError(
                    f"{self.path} belongs to another training ({'; '.join(changed[:4])}); "
                    "choose another --run, or remove the folder to start again"
                )
        write_config(path, config)
        if not self._checkpoint("latest").exists():  # training starts again: rows of a killed run would appear twice
            (self.path / METRICS).unlink(missing_ok=True)

    # -- checkpoints -----------------------------------------------------------------------------------------------

    def save(self, name: str, tensors: Mapping[str, Tensor], facts: Mapping[str, Any]) -> None:
        """Write ``checkpoints/<name>.safetensors`` atomically, with a checksum."""
        plain = {key: tensor.detach().cpu().contiguous() for key, tensor in tensors.items()}
        told = {**facts, "sha256": _checksum(plain, facts)}
        with atomic_write(self._checkpoint(name)) as temporary:
            temporary.write_bytes(save(plain, metadata={"facts": json.dumps(told)}))

    def load(self, name: str) -> tuple[dict[str, Tensor], dict[str, Any]] | None:
        """The tensors and facts of a checkpoint; None if it does not exist.

        Raises:
            TrainingError: the file is damaged.
        """
        path = self._checkpoint(name)
        if not path.exists():
            return None
        try:
            with safe_open(path, framework="pt") as file:
                facts = json.loads((file.metadata() or {})["facts"])
                tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
            if facts.pop("sha256", None) not in (None, _checksum(tensors, facts)):  # None: written by an older version
                raise ValueError("its checksum is wrong")
        except (SafetensorError, OSError, LookupError, TypeError, AttributeError, ValueError) as error:
            raise TrainingError(f"{path} is damaged ({error}); remove {path.parent} to train from the start") from error
        return tensors, facts

    def _checkpoint(self, name: str) -> Path:
        return self.path / "checkpoints" / f"{name}.safetensors"

    # -- metrics ---------------------------------------------------------------------------------------------------

    def rewind(self, order: tuple[str, ...], stage: str, step: int) -> None:
        """Delete the rows recorded after a checkpoint, because training will write them again."""
        reached = (order.index(stage), step)
        steps = [row for row in self.rows() if isinstance(row, StepMetrics) and row.stage in order]
        write_metrics(self.path / METRICS, [row for row in steps if (order.index(row.stage), row.step) <= reached])

    def rows(self) -> list[MetricsRow]:
        """The complete rows of ``metrics.jsonl``; none if there is no such file.

        Raises:
            ResultFileError: the file is damaged.
        """
        path = self.path / METRICS
        return read_metrics(path) if path.exists() else []

    def record(self, row: MetricsRow) -> None:
        """Append a row to ``metrics.jsonl``, and its numbers to TensorBoard if it belongs to a step."""
        append_metrics(self.path / METRICS, row)
        if isinstance(row, StepMetrics):
            with writing(self.path):
                self._show(row)

    def _show(self, row: StepMetrics) -> None:
        if self._board is None:
            self._board = SummaryWriter(str(self.path / "tensorboard"))
        for name, value in row.values.items():
            if isinstance(value, float):
                self._board.add_scalar(f"{row.stage}/{name}", value, row.step)
        self._board.flush()

    def close(self) -> None:
        """Close the TensorBoard file."""
        if self._board is not None:
            self._board.close()


def _checksum(tensors: Mapping[str, Tensor], facts: Mapping[str, Any]) -> str:
    digest = hashlib.sha256(json.dumps(dict(facts), sort_keys=True).encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> list[str]:
    changed = []
    for key in sorted({*found, *wanted}):
        old, new = found.get(key), wanted.get(key)
        if isinstance(old, dict) and isinstance(new, dict):
            changed += _differences(old, new, f"{prefix}{key}.")
        elif old != new and key not in _FREE:
            changed.append(f"{prefix}{key} was {old}, is {new}")
    return changed
