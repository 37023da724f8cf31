"""What a folder of outputs says: is anything half-written, how far has the work come, does it equal another one?"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import yaml
from PIL import Image
from safetensors import SafetensorError, safe_open

_TIMES = ("seconds", "steps_per_second", "sha256")
_STAGES = ("vae", "predictor", "finetune", "train")
_UNREADABLE = (OSError, ValueError, KeyError, RuntimeError, SafetensorError, yaml.YAMLError)


def files(folder: Path, *, hidden: bool = False) -> dict[str, Path]:
    """Every file below a folder by its relative name, without TensorBoard's, whose names hold the time."""
    found = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {
        name: path
        for name, path in found.items()
        if "tensorboard/" not in name and (hidden or not path.name.startswith("."))
    }


def half_written(folder: Path) -> list[str]:
    """The visible files that cannot be read to their ends."""
    return [f"{name} is half-written" for name, path in files(folder).items() if not _whole(path)]


def _whole(path: Path) -> bool:
    try:
        match path.suffix:
            case ".hdf5":
                with h5py.File(path, "r") as file:
                    _contents(file)
            case ".safetensors":
                _tensors(path)
            case ".json":
                json.loads(path.read_text(encoding="utf-8"))
            case ".yaml":
                return isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)
            case ".jsonl" | ".journal":  # the last line may be cut: it is dropped on resuming
                for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
                    if line.endswith("\n"):
                        json.loads(line)
            case ".png":
                Image.open(path).load()
            case ".html":
                return path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    except _UNREADABLE:
        return False
    return True


def progress(folder: Path) -> float:
    """How much is safe: demonstrations, episodes or training steps; never less than before, whatever happened."""
    done = len(list(folder.glob("*.parts/*.hdf5")))
    for journal in folder.rglob("*.journal"):
        done += journal.read_bytes().count(b"\n") - 1
    for cell in folder.glob("out/*.json"):  # of a matrix
        done += len(json.loads(cell.read_text(encoding="utf-8"))["runs"])
    for checkpoint in folder.glob("*/checkpoints/latest.safetensors"):
        facts = _tensors(checkpoint)[1]
        done += 1000 * _STAGES.index(facts.get("stage", "train")) + facts["step"]
    return float(done)


def differences(reference: Path, folder: Path) -> list[str]:
    """How a folder differs from another one, hidden files included."""
    wanted, found = files(reference, hidden=True), files(folder, hidden=True)
    result = [f"{name} is missing" for name in wanted.keys() - found.keys()]
    result += [f"{name} was left behind" for name in found.keys() - wanted.keys()]
    return result + [f"{name} differs" for name in wanted.keys() & found.keys() if not _same(wanted[name], found[name])]


def compared_as(reference: Path, folder: Path) -> str:
    """How two folders without differences are the same: ``bytes``, or ``arrays`` where some file's bytes differ."""
    wanted, found = files(reference), files(folder)
    timed = [name for name in wanted if Path(name).name in ("metrics.jsonl", "report.html", "latest.safetensors")]
    equal = all(path.read_bytes() == found[name].read_bytes() for name, path in wanted.items() if name not in timed)
    return "bytes" if equal else "arrays"


def _same(one: Path, other: Path) -> bool:
    if one.suffix == ".html":  # a page with the time that training took
        return _whole(other)
    if one.read_bytes() == other.read_bytes():
        return True
    match one.suffix:
        case ".hdf5":
            with h5py.File(one, "r") as first, h5py.File(other, "r") as second:
                return _equal(_contents(first), _contents(second))
        case ".jsonl":
            first, second = _rows(one), _rows(other)
            return len(first) == len(second) and all(map(_near, first, second))
        case ".safetensors":
            if not _whole(other):
                return False
            (tensors, facts), (others, other_facts) = _tensors(one), _tensors(other)
            return _equal(tensors, others) and _timeless(facts) == _timeless(other_facts)
        case _:
            return False


def _equal(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return one.keys() == other.keys() and all(_identical(one[key], other[key]) for key in one)


def _identical(one: Any, other: Any) -> bool:
    first, second = np.asarray(one), np.asarray(other)
    return first.dtype == second.dtype and first.shape == second.shape and first.tobytes() == second.tobytes()


def _contents(file: h5py.File) -> dict[str, Any]:
    """Every array and attribute of an HDF5 file by its path."""

    def walk(group: h5py.Group) -> Iterator[tuple[str, Any]]:
        for name, value in group.attrs.items():
            yield f"{group.name}@{name}", str(value)
        for item in group.values():
            if isinstance(item, h5py.Group):
                yield from walk(item)
            else:
                yield str(item.name), item[()]

    return dict(walk(file))


def _rows(path: Path) -> list[dict[str, Any]]:
    return [_timeless(json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def _near(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Equal but for rounding: even undisturbed runs with equal weights differ in an error's last digit."""
    return one.keys() == other.keys() and all(
        math.isclose(one[key], other[key], rel_tol=1e-12) if isinstance(one[key], float) else one[key] == other[key]
        for key in one
    )


def _timeless(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in _TIMES}


def _tensors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors, and the facts of a checkpoint."""
    with safe_open(path, framework="np") as file:
        facts = json.loads((file.metadata() or {}).get("facts", "{}"))
        return {key: file.get_tensor(key) for key in file.keys()}, facts  # noqa: SIM118
