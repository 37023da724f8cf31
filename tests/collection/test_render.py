import contextlib
import hashlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.collection.render import render_dataset
from ocplanner.collection.settings import RenderSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, InvalidValueError, OutputError, UnknownNameError
from ocplanner.rollouts.settings import WorkerSettings

SMALL = RenderSettings(silhouettes=(), size=24, frames="manipulation")


def _content(path: Path) -> str:
    digest = hashlib.sha256()
    with Demonstrations(path) as demos:
        for demo in demos:
            for key, array in sorted(demo.arrays().items()):
                digest.update(f"{demo.name}/{key}".encode() + array.tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def rendered(tiny_square, tmp_path_factory) -> Path:
    return render_dataset(tiny_square(), tmp_path_factory.mktemp("rendered") / "square.hdf5", SMALL)


def test_the_copy_has_everything_and_the_pictures(tiny_square, rendered):
    with Demonstrations(tiny_square()) as source, Demonstrations(rendered) as copy:
        assert copy.names == source.names
        assert copy.env_args == source.env_args
        assert copy.cameras == ("agentview",)
        assert {name: copy.mask(name) for name in copy.mask_names} == {
            name: source.mask(name) for name in source.mask_names
        }
        record = copy.render_record
        assert record is not None
        assert (record.observe, record.visual, record.frames, record.size) == ("masked", "fast", "manipulation", 24)
        assert record.mask_rgb == (255, 0, 255)
        assert record.versions["robosuite"] == "1.5.2"
        for before, after in zip(source, copy):
            for key, array in before.arrays().items():
                np.testing.assert_array_equal(after.arrays()[key], array)
            assert after.images("agentview").shape == (before.length, 24, 24, 3)
            assert after.observation("agentview_mask").dtype == bool


@pytest.mark.parametrize("observe", ["full", "no-robot"])
def test_plain_pictures_need_no_masks(tiny_square, tmp_path, observe):
    settings = RenderSettings(observe=observe, size=16, cameras=("agentview", "robot0_eye_in_hand"))
    path = render_dataset(tiny_square("1.5.1"), tmp_path / "plain.hdf5", settings, limit=1)
    with Demonstrations(path) as demos:
        assert len(demos) == 1
        demo = demos[0]
        assert set(demo.cameras) == {"agentview", "robot0_eye_in_hand"}
        assert not any(key.endswith(("_mask", "_empty")) for key in demo.observation_keys)
        assert demo.images("agentview").any((1, 2, 3)).all()
        assert demos.mask("train") == ["demo_0"]
        assert "model_file" in demo.attrs


def test_a_killed_run_goes_on_and_ends_the_same(tiny_square, rendered, tmp_path):
    target = tmp_path / "killed.hdf5"
    process = multiprocessing.get_context("spawn").Process(target=render_dataset, args=(tiny_square(), target, SMALL))
    process.start()
    parts = target.with_name("killed.hdf5.parts")
    deadline = time.monotonic() + 120
    while not list(parts.glob("*.hdf5")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid or 0, signal.SIGKILL)
    process.join()
    assert not target.exists()
    kept = len(list(parts.glob("*.hdf5")))
    assert kept > 0
    seen = []
    render_dataset(tiny_square(), target, SMALL, progress=lambda name, length: seen.append((name, length)))
    assert len(seen) == 4
    assert _content(target) == _content(rendered)
    assert not parts.exists()


def test_a_killed_run_does_not_go_on_from_another_source_of_the_same_names(tiny_square, tmp_path):
    other, target = tmp_path / "other.hdf5", tmp_path / "out.hdf5"
    shutil.copy(tiny_square(), other)
    with h5py.File(other, "r+") as file:
        file["data/demo_0/states"][:, 17] += 0.01

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(tiny_square(), target, SMALL, progress=stop)
    with pytest.raises(OutputError, match=r"was made from another demo_0 than the source's now.*delete .*parts"):
        render_dataset(other, target, SMALL)
    assert [part.stem for part in target.with_name("out.hdf5.parts").glob("*.hdf5")] == ["demo_0"]


def test_an_impatient_ctrl_c_ends_at_once_and_keeps_what_is_done(tiny_square, tmp_path):
    target = tmp_path / "stopped.hdf5"
    # Pictures so large that the last demonstrations take seconds after the first is done.
    command = [sys.executable, "-m", "ocplanner", "render", str(tiny_square()), str(target), "--size", "160"]
    with subprocess.Popen(
        [*command, "--frames", "manipulation"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell's background job ignores the signal, and what it starts would too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        parts = target.with_name("stopped.hdf5.parts")
        deadline = time.monotonic() + 120
        while not list(parts.glob("*.hdf5")) and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.02)
        for _ in range(2):
            os.killpg(process.pid, signal.SIGINT)  # the terminal sends it to the workers too
            time.sleep(0.1)
        try:
            _, told = process.communicate(timeout=30)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130, told
    assert "run the same command again" in told
    assert list(parts.glob("*.hdf5"))


def test_workers_do_not_change_the_result(tiny_square, rendered, tmp_path):
    path = render_dataset(tiny_square(), tmp_path / "two.hdf5", SMALL, WorkerSettings(2))
    assert _content(path) == _content(rendered)


def test_a_target_that_exists_is_kept(tiny_square, rendered):
    with pytest.raises(OutputError, match="exists"):
        render_dataset(tiny_square(), rendered, SMALL)


def test_states_of_another_model_are_refused(tiny_square, tmp_path):
    broken = tmp_path / "broken.hdf5"
    shutil.copy(tiny_square(), broken)
    with h5py.File(broken, "r+") as file:
        for demo in file["data"].values():
            states = demo["states"][:]
            del demo["states"]
            demo["states"] = np.concatenate([states, states[:, :2]], axis=1)
    with pytest.raises(DatasetError):
        render_dataset(broken, tmp_path / "out.hdf5", SMALL)
    with pytest.raises(InvalidValueError, match="limit is 0"):
        render_dataset(broken, tmp_path / "out.hdf5", SMALL, limit=0)


def test_a_mistaken_camera_is_told_from_a_worker_and_can_be_corrected(tiny_square, tmp_path):
    target = tmp_path / "mistaken.hdf5"
    with pytest.raises(UnknownNameError, match="agentview"):
        render_dataset(tiny_square(), target, RenderSettings(cameras=("wrist",)), WorkerSettings(2))
    render_dataset(tiny_square(), target, RenderSettings(observe="full", size=8), limit=1)
