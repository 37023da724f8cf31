"""The folder of one training: configuration, metrics, TensorBoard events and checkpoints, all safe against a kill."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
import yaml
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from ocplanner.errors import TrainingError
from ocplanner.files.storage import atomic_write, writing

_FREE = ("threads", "device")
"""Settings that may change between a stop and its continuation."""


class RunFolder:
    """Reads and writes a run folder, of a planner or of a policy.

    A planner's ``metrics.jsonl`` has one JSON object a line:
    ``{"stage", "step", "seconds", "loss", "valid_loss", "ade_mm", ...}`` at every validation (losses of Figure 4;
    errors as in :class:`ocplanner.planner.metrics.PlanErrors`), and at the end
    ``{"stage": "final", "candidate", "kept", "appearance", ...}`` for every candidate and appearance.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with writing(path):
            (path / "checkpoints").mkdir(parents=True, exist_ok=True)
        self._board: SummaryWriter | None = None

    def claim(self, settings: Mapping[str, Any]) -> None:
        """Write ``config.yaml``, or check that the one there says the same; without a checkpoint drop the metrics.

        Raises:
            TrainingError: the folder belongs to a training with other settings or data.
        """
        path = self.path / "config.yaml"
        if path.exists():
            try:
                found = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
                if not isinstance(found, dict):
                    raise ValueError(f"it holds {type(found).__name__}")
            except (ValueError, yaml.YAMLError) as error:
                raise TrainingError(
                    f"{path} is damaged ({_first_line(error)}); remove the run folder or choose another --run"
                ) from error
            changed = _differences(found, dict(settings))
            if changed:
                raise TrainingError(
                    f"{self.path} belongs to another training ({'; '.join(changed[:4])}); "
                    "choose another --run, or remove the folder to start anew"
                )
        with atomic_write(path) as temporary:
            temporary.write_text(yaml.safe_dump(dict(settings), sort_keys=False), encoding="utf-8")
        if not self._checkpoint("latest").exists():  # training begins anew: rows of a killed one would stand twice
            (self.path / "metrics.jsonl").unlink(missing_ok=True)

    # -- checkpoints -----------------------------------------------------------------------------------------------

    def save(self, name: str, tensors: Mapping[str, Tensor], facts: Mapping[str, Any]) -> None:
        """Write ``checkpoints/<name>.safetensors`` atomically, with a checksum."""
        plain = {key: tensor.detach().cpu().contiguous() for key, tensor in tensors.items()}
        told = {**facts, "sha256": _checksum(plain, facts)}
        with atomic_write(self._checkpoint(name)) as temporary:
            temporary.write_bytes(save(plain, metadata={"facts": json.dumps(told)}))

    def load(self, name: str) -> tuple[dict[str, Tensor], dict[str, Any]] | None:
        """The tensors and facts of a checkpoint; None when there is none.

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
            if facts.pop("sha256", None) not in (None, _checksum(tensors, facts)):  # none: by an older version
                raise ValueError("its checksum is wrong")
        except (SafetensorError, OSError, LookupError, TypeError, AttributeError, ValueError) as error:
            raise TrainingError(f"{path} is damaged ({error}); remove {path.parent} to train from the start") from error
        return tensors, facts

    def _checkpoint(self, name: str) -> Path:
        return self.path / "checkpoints" / f"{name}.safetensors"

    # -- metrics ---------------------------------------------------------------------------------------------------

    def rewind(self, order: tuple[str, ...], stage: str, step: int) -> None:
        """Drop the rows recorded after a checkpoint, which training will write again."""
        reached = (order.index(stage), step)
        rows = [
            row for row in self.rows() if row["stage"] in order and (order.index(row["stage"]), row["step"]) <= reached
        ]
        with atomic_write(self.path / "metrics.jsonl") as temporary:
            temporary.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")

    def rows(self) -> list[dict[str, Any]]:
        """The complete rows of ``metrics.jsonl``."""
        path = self.path / "metrics.jsonl"
        if not path.exists():
            return []
        rows = []
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                rows.append(json.loads(line))
            except ValueError:  # a kill cut the last line
                break
        return rows

    def record(self, row: Mapping[str, Any]) -> None:
        """Append a row to ``metrics.jsonl`` and its numbers to TensorBoard."""
        with writing(self.path):
            with (self.path / "metrics.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(dict(row)) + "\n")
            if "step" in row:
                self._show(row)

    def _show(self, row: Mapping[str, Any]) -> None:
        if self._board is None:
            self._board = SummaryWriter(str(self.path / "tensorboard"))
        for key, value in row.items():
            if isinstance(value, float):
                self._board.add_scalar(f"{row['stage']}/{key}", value, row["step"])
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


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> list[str]:
    changed = []
    for key in sorted({*found, *wanted}):
        old, new = found.get(key), wanted.get(key)
        if isinstance(old, dict) and isinstance(new, dict):
            changed += _differences(old, new, f"{prefix}{key}.")
        elif old != new and key not in _FREE:
            changed.append(f"{prefix}{key} was {old}, is {new}")
    return changed
