"""Faults inside files: damaged checkpoints, truncated data sets, safetensors with hostile metadata."""

import json
import random
import shutil
import struct
import sys
import time
from pathlib import Path
from typing import Any

import folders
from bench import Bench
from rows import Row

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "fuzz")]

from choices import Choices  # noqa: E402 - beside the fuzzer
from hostile_files import _VALUES, hostile_file  # noqa: E402

_MOST_MEMORY_MB = 2500.0
"""More than any verb needs on tiny data; a hostile file must not make it ask for more."""


def damaged_checkpoint(bench: Bench, row: Row, tries: int) -> None:
    """Kill the verb, damage one of the files that it resumes from, and run it again.

    It must say which file is damaged, leave that as it is and lose no other, or end with the undisturbed result all the
    same. Once what the error names is removed it must succeed.
    """
    assert bench.reference.span_s > 0
    while row.tries < tries:
        target = _interrupted(bench)
        if target is None:
            continue
        row.tries += 1
        what = _damage(target, bench.rng)
        before = {name: path.read_bytes() for name, path in folders.files(bench.work).items()}
        ending = bench.start().wait()
        if ending.code == 0:
            bench.judge(ending, row)
            continue
        if not ending.clear or not (target.name in ending.text or target.parent.name in ending.text):
            row.wonder(f"{target.name} {what}: {ending.complaint}")
        after = {name: path.read_bytes() for name, path in folders.files(bench.work).items()}
        damaged = str(target.relative_to(bench.work))
        gone = [name for name in before if name not in after or (name == damaged and after[name] != before[name])]
        if gone:
            row.lose(f"{target.name} {what}: {', '.join(gone)} changed or gone")
        _remove(target)
        bench.finish(row)


def _interrupted(bench: Bench) -> Path | None:
    """Kill the verb after a while; one of the files that it would resume from, None when there is none yet."""
    bench.clear()
    running = bench.start()
    bench.await_work(running)
    until = time.monotonic() + bench.rng.uniform(0.2, 1.0) * bench.reference.span_s
    while running.poll() is None and time.monotonic() < until:
        time.sleep(0.001)
    if not running.kill():
        return None
    patterns = (
        "*.parts/*",
        "**/*.journal",
        "run/checkpoints/[!v]*",
        "run/config.yaml",
    )  # no verb reads the VAE's checkpoint again
    found = [path for pattern in patterns for path in sorted(bench.work.glob(pattern)) if path.name[0] != "."]
    return bench.rng.choice(found) if found else None


def _damage(path: Path, rng: random.Random) -> str:
    """Damage a file; how."""
    content = bytearray(path.read_bytes())
    kinds = ["emptied", "cut", "with a byte changed", "filled with noise"]
    if path.suffix == ".safetensors":
        kinds.append("with hostile metadata")
    kind = rng.choice(kinds)
    if kind == "emptied":
        content.clear()
    elif kind == "cut":
        del content[rng.randrange(len(content)) :]
    elif kind == "with a byte changed":
        content[rng.randrange(len(content))] ^= rng.randint(1, 255)
    elif kind == "filled with noise":
        content[:] = rng.randbytes(len(content))
    else:
        content[:] = hostile_metadata(bytes(content), rng)
    path.write_bytes(content)
    return kind


def _remove(path: Path) -> None:
    """What the error tells people to remove."""
    if path.name in ("header.json", "config.yaml") or path.parent.name == "checkpoints":
        shutil.rmtree(path.parent)
    else:
        path.unlink()


def truncated_data(bench: Bench, row: Row, tries: int) -> None:
    """Read a data set that ends too early, at a random byte."""
    kind = bench.verb.reads[0]
    whole = getattr(bench.material, kind)
    cut = bench.material.folder / "cut.hdf5"
    content = whole.read_bytes()
    for _ in range(tries):
        cut.write_bytes(content[: bench.rng.randrange(len(content))])
        _refuses(bench, row, kind, cut, may_succeed=False)


def hostile_planner(bench: Bench, row: Row, tries: int) -> None:
    """Read a planner file made by the fuzzer, or a real one with hostile metadata."""
    hostile = bench.material.folder / "hostile.safetensors"
    real = bench.material.planner.read_bytes()
    for number in range(tries):
        made = hostile_file(Choices(bench.rng.randbytes(64))) if number % 2 else hostile_metadata(real, bench.rng)
        hostile.write_bytes(made)
        _refuses(bench, row, "planner", hostile, may_succeed=True)


def hostile_policy(bench: Bench, row: Row, tries: int) -> None:
    """Read a policy file with hostile metadata."""
    hostile = bench.material.folder / "hostile.safetensors"
    real = bench.material.policy.read_bytes()
    for _ in range(tries):
        hostile.write_bytes(hostile_metadata(real, bench.rng))
        _refuses(bench, row, "policy", hostile, may_succeed=True)


def _refuses(bench: Bench, row: Row, kind: str, path: Path, *, may_succeed: bool) -> None:
    """One try with a bad input: a clear error, bounded memory, the input as it was, no output."""
    bench.clear()
    row.tries += 1
    content = path.read_bytes()
    ending = bench.start(**{kind: path}).wait()
    succeeded = ending.code == 0 and may_succeed
    if not succeeded and not (ending.clear and path.name in ending.text):
        row.wonder(ending.complaint)
    elif ending.memory_mb > _MOST_MEMORY_MB:
        row.wonder(f"{ending.memory_mb:.0f} MB of memory; {ending.complaint}")
    if path.read_bytes() != content:
        row.lose("the input changed")
    if not succeeded and bench.verb.output is not None and bench.output.exists():
        row.lose("there is an output from a bad input")


def hostile_metadata(content: bytes, rng: random.Random) -> bytes:
    """A safetensors file with up to three entries of its JSON metadata made hostile."""
    size = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + size])
    key, text = next(iter(header["__metadata__"].items()))
    value = json.loads(text)
    for _ in range(rng.randint(1, 3)):
        _poison(value, rng)
    text = json.dumps(value)
    if rng.random() < 0.15:
        text = rng.choice(("", "{", "null", "[" * 5000, "[]", '"\\ud800"', text[: rng.randrange(len(text))]))
    header["__metadata__"][key] = text
    if rng.random() < 0.1:
        header["__metadata__"] = rng.choice(({}, {"other": text}, {key: ""}))
    packed = json.dumps(header).encode()
    return struct.pack("<Q", len(packed)) + packed + content[8 + size :]


def _poison(value: Any, rng: random.Random) -> None:
    """Replace or remove one entry somewhere inside."""
    while isinstance(value, dict) and value:
        key = rng.choice(sorted(value))
        inside = value[key]
        if isinstance(inside, dict) and inside and rng.random() < 0.8:
            value = inside
            continue
        if rng.random() < 0.15:
            del value[key]
        else:
            value[key] = rng.choice(_VALUES)
        return
