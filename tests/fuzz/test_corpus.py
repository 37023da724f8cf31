"""Failures that fuzzing once found, and a few seconds of fuzzing from a fixed seed.

``corpus/`` holds planner files, so it stays valid when the fuzzer reads its bytes in another way. Calls are code.
"""

import json
import random
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from fuzz_core import one_input, random_input
from targets import TARGETS

from ocplanner import _core
from ocplanner.errors import InvalidValueError, ModelFileError, OcplannerError, ShapeError

CORPUS = {
    "large_crop": "image_size is 5000",
    "long_decoding": "horizon x modes x decoder.hidden is 268435456",
    "overflowing_beliefs": "probability of a plan",
}
EYE = np.eye(3)
POSE = (np.zeros(3), EYE)


@pytest.fixture(autouse=True)
def quiet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy may warn about hostile numbers; MuJoCo writes its log to where it runs."""
    warnings.simplefilter("ignore")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", CORPUS)
def test_files_that_once_failed_are_errors(name: str) -> None:
    data = (Path(__file__).parent / "corpus" / f"{name}.safetensors").read_bytes()
    with pytest.raises(OcplannerError, match=CORPUS[name]):
        plan_once(data)


def plan_once(data: bytes) -> None:
    engine = _core.PlannerEngine(data)
    config = json.loads(engine.config_json)
    size = config["image_size"]
    engine.plan([np.zeros((1, size, size, 3), np.uint8) for _ in config["cameras"]], all_modes=True)


def test_the_corpus_is_replayed_whole() -> None:
    assert {path.stem for path in (Path(__file__).parent / "corpus").iterdir()} == set(CORPUS)


def far_apart(position: float) -> tuple[np.ndarray, np.ndarray]:
    return np.full(3, position), EYE


def misaligned() -> np.ndarray:
    return np.frombuffer(bytearray(8 * 3 + 1), np.float64, 3, offset=1)


CALLS: dict[str, tuple[type[Exception], Callable[[], object]]] = {
    "action of infinite length": (
        InvalidValueError,
        lambda: _core.delta_pose_action(far_apart(1.7e308), far_apart(-1.7e308), POSE, EYE),
    ),
    "command of infinite length": (
        InvalidValueError,
        lambda: _core.delta_pose_action(POSE, far_apart(2.0), POSE, EYE, _core.DeltaPoseLaw(gain_position=1.7e308)),
    ),
    "images broadcast to more than fit in memory": (
        ShapeError,
        lambda: _core.PlannerEngine(_valid_file()).plan(np.broadcast_to(np.uint8(0), (1 << 40, 1, 6, 6, 3))),  # type: ignore[arg-type]
    ),
    "pose of one": (ShapeError, lambda: _core.delta_pose_action((np.zeros(3),), POSE, POSE, EYE)),  # type: ignore[arg-type]
    "pose of three": (ShapeError, lambda: _core.delta_pose_action((np.zeros(3), EYE, EYE), POSE, POSE, EYE)),  # type: ignore[arg-type]
    "misaligned position": (ShapeError, lambda: _core.delta_pose_action((misaligned(), EYE), POSE, POSE, EYE)),
    "result of 33 axes": (ShapeError, lambda: _core.rotation_exp(np.zeros((1,) * 31 + (3,)))),
    "misaligned rows": (ShapeError, lambda: _core.rotation_exp(misaligned())),
    "name that is no Unicode": (InvalidValueError, lambda: _core.DeltaPoseController("\ud800")),
    "storage that is no Unicode": (InvalidValueError, lambda: _core.PlannerEngine(b"", "\ud800")),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("call", CALLS)
def test_calls_that_once_failed_are_errors(call: str) -> None:
    expected, act = CALLS[call]
    with pytest.raises(expected):
        act()


def test_a_tiny_scale_keeps_the_action_within_limits() -> None:
    law = _core.DeltaPoseLaw(limit_horizontal=5e-324, limit_vertical=5e-324, scale_position=5e-324)
    action = _core.delta_pose_action(POSE, far_apart(0.2), POSE, EYE, law)
    assert (np.abs(action) <= 1).all()


@pytest.mark.parametrize("threads", [-1, 1 << 64, -(1 << 80)])
def test_impossible_counts_are_named(threads: int) -> None:
    engine = _core.PlannerEngine(_valid_file())
    images = [np.zeros((1, 6, 6, 3), np.uint8)]
    with pytest.raises(InvalidValueError, match=f"^{threads} is not a count"):
        engine.plan(images, threads=threads)
    with pytest.raises(InvalidValueError, match=f"^{threads} is not a count"):
        engine.plan(images, steps=threads)


def test_any_number_of_threads_gives_the_plan() -> None:
    engine = _core.PlannerEngine(_valid_file())
    images = [np.zeros((3000, 6, 6, 3), np.uint8)]
    np.testing.assert_array_equal(engine.plan(images, threads=1 << 40)[0], engine.plan(images)[0])


def test_flags_may_hold_any_byte() -> None:
    flags = np.array([0, 1, 7, 255], np.uint8)
    poses = (np.arange(12.0).reshape(4, 3), None)
    terms = [
        _core.RewardLaw().rewards(poses, (np.zeros((4, 3)), None), held)[2] for held in (flags.view(bool), flags > 0)
    ]
    np.testing.assert_array_equal(*terms)


def _valid_file() -> bytes:
    from choices import Choices
    from hostile_files import hostile_file

    return hostile_file(Choices(b""))


def test_random_calls_give_results_or_errors_of_ours() -> None:
    rng = random.Random(20240)  # noqa: S311
    end = time.monotonic() + 5
    while time.monotonic() < end:
        data = random_input(rng)
        try:
            one_input(data)
        except BaseException as error:
            raise AssertionError(f"input {data.hex()}") from error


def test_every_public_name_is_fuzzed() -> None:
    names = {name for name in vars(_core) if not name.startswith("_")}
    assert names == set(TARGETS)


def test_harmless_choices_succeed() -> None:
    """Otherwise the fuzzer would only ever see the errors of its own mistakes."""
    from choices import Choices

    for callers in TARGETS.values():
        for caller in callers:
            caller(Choices(b""))


def test_a_damaged_file_is_an_error() -> None:
    with pytest.raises(ModelFileError):
        _core.PlannerEngine(_valid_file()[:-1])
