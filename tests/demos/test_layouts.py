"""The order of ``object``: found from every witness alone, and refused when witnesses contradict or are missing."""

import json
import shutil

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.layouts import (
    ORDERS,
    detect_order,
    find_in_states,
    order_from_relative_pose,
    order_from_version,
    split_object,
)
from ocplanner.errors import DatasetError, ObjectLayoutError, UnknownNameError
from ocplanner.geometry.rotation import rotation_from_quat_xyzw

SQUARE = "NutAssemblySquare"


def _quat(rng: np.random.Generator, steps: int) -> np.ndarray:
    quat = rng.normal(size=(steps, 4))
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)


def _quat_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """xyzw of (T, 3, 3), by the eigenvector of Bar-Itzhack's matrix: independent of the code under test."""
    quats = []
    for r in rotation:
        k = np.array(
            [
                [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
                [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
                [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
            ]
        )
        quats.append(np.linalg.eigh(k)[1][:, -1])
    return np.array(quats)


class Recording:
    """Random but consistent object, end effector and states."""

    def __init__(self, seed: int, steps: int = 12, slot: int = 10) -> None:
        rng = np.random.default_rng(seed)
        self.pose = np.concatenate([rng.uniform(-1, 1, (steps, 3)), _quat(rng, steps)], axis=1)
        self.eef_pos, self.eef_quat = rng.uniform(-1, 1, (steps, 3)), _quat(rng, steps)
        rotation_eef = rotation_from_quat_xyzw(self.eef_quat)
        offset = np.einsum("tji,tj->ti", rotation_eef, self.pose[:, :3] - self.eef_pos)
        turned = np.einsum("tji,tjk->tik", rotation_eef, rotation_from_quat_xyzw(self.pose[:, 3:].copy()))
        relative = np.concatenate([offset, _quat_from_rotation(turned)], axis=1)
        self.object = {
            "absolute-first": np.concatenate([self.pose, relative], axis=1),
            "relative-first": np.concatenate([relative, self.pose], axis=1),
        }
        self.states = rng.uniform(-1, 1, (steps, 45))
        self.states[:, slot : slot + 7] = self.pose[:, [0, 1, 2, 6, 3, 4, 5]]


seeds = st.integers(0, 2**32 - 1)


@settings(deadline=None)
@given(seeds, st.sampled_from(ORDERS), st.sampled_from(["version", "relative", "states", "all"]))
def test_every_witness_alone_finds_the_order(seed, order, witness):
    record = Recording(seed)
    found = detect_order(
        record.object[order],
        SQUARE,
        env_version={"absolute-first": "1.4.1", "relative-first": "1.5.1"}[order]
        if witness in ("version", "all")
        else None,
        eef_pos=record.eef_pos if witness in ("relative", "all") else None,
        eef_quat_xyzw=record.eef_quat if witness in ("relative", "all") else None,
        states=record.states if witness in ("states", "all") else None,
    )
    assert found == order
    np.testing.assert_array_equal(split_object(record.object[order], SQUARE, "SquareNut", found), record.pose)


@settings(deadline=None)
@given(seeds, st.sampled_from(ORDERS), st.booleans(), st.booleans())
def test_a_version_that_lies_is_found_out(seed, order, with_eef, stated):
    record = Recording(seed)
    wrong = {"absolute-first": "1.5.1", "relative-first": "1.4.1"}[order]
    other = next(o for o in ORDERS if o != order)
    with pytest.raises(ObjectLayoutError, match="contradictory"):
        detect_order(
            record.object[order],
            SQUARE,
            env_version=None if stated else wrong,
            stated=other if stated else None,
            eef_pos=record.eef_pos if with_eef else None,
            eef_quat_xyzw=record.eef_quat if with_eef else None,
            states=None if with_eef else record.states,
        )


@settings(deadline=None)
@given(seeds, st.integers(0, 38), st.booleans())
def test_the_free_joint_is_found_wherever_it_stands(seed, slot, flipped):
    record = Recording(seed, slot=slot)
    pose = record.pose * ([1, 1, 1, -1, -1, -1, -1] if flipped else 1)  # q and -q are one rotation
    assert find_in_states(pose, record.states) == slot
    assert find_in_states(record.pose + 0.1, record.states) is None


@pytest.mark.parametrize(
    ("version", "order"),
    [
        ("1.0.0", "absolute-first"),
        ("1.4.1", "absolute-first"),
        ("v1.4.1", "absolute-first"),
        ("1.5.0", "relative-first"),
        ("1.10", "relative-first"),
        ("2.0.0", "relative-first"),
        ("", None),
        ("main", None),
        (None, None),
    ],
)
def test_order_from_version(version, order):
    assert order_from_version(version) == order


def test_no_witness_is_an_error_not_a_guess():
    with pytest.raises(ObjectLayoutError, match=r"is unknown.*object_layout='absolute-first'"):
        detect_order(Recording(0).object["absolute-first"], SQUARE, env_version=None)


def test_stating_the_order_replaces_the_version():
    record = Recording(0)
    found = detect_order(record.object["relative-first"], SQUARE, env_version="1.4.1", stated="relative-first")
    assert found == "relative-first"


def test_states_of_another_recording_are_refused():
    with pytest.raises(ObjectLayoutError, match="does not belong to `states`"):
        detect_order(Recording(0).object["absolute-first"], SQUARE, env_version="1.4.1", states=Recording(1).states)


def test_a_degenerate_relative_pose_has_no_vote():
    pose = np.tile([0.0, 0, 0, 0, 0, 0, 1], (5, 2))  # object and end effector at the origin: both orders fit
    eef = np.zeros((5, 3)), np.tile([0.0, 0, 0, 1], (5, 1))
    assert order_from_relative_pose(pose, *eef) is None


def test_unknown_environment_and_width():
    with pytest.raises(ObjectLayoutError, match=r"is unknown for environment 'Door'; known: .*NutAssemblySquare"):
        detect_order(np.zeros((3, 14)), "Door", env_version="1.4.1")
    with pytest.raises(ObjectLayoutError, match=r"expected \(steps, 10\)"):
        detect_order(np.zeros((3, 14)), "Lift", env_version="1.4.1")


def test_lift_has_one_order_and_is_checked_against_states():
    record = Recording(3)
    lift = np.concatenate([record.pose, record.pose[:, :3] - record.eef_pos], axis=1)
    assert detect_order(lift, "Lift", env_version=None, states=record.states) == "absolute-first"
    np.testing.assert_array_equal(split_object(lift, "Lift", "cube", "absolute-first"), record.pose)
    with pytest.raises(ObjectLayoutError, match="cube"):
        detect_order(lift, "Lift", env_version="1.5.0", states=Recording(4).states)
    with pytest.raises(UnknownNameError, match="known: cube"):
        split_object(lift, "Lift", "Can", "absolute-first")


@pytest.mark.parametrize("version", ["1.4.1", "1.5.1"])
def test_a_file_with_the_wrong_version_is_refused(tiny_square, tmp_path, version):
    path = shutil.copy(tiny_square(version), tmp_path / "lying.hdf5")
    with h5py.File(path, "r+") as file:
        args = json.loads(file["data"].attrs["env_args"])
        args["env_version"] = "1.5.1" if version == "1.4.1" else "1.4.1"
        file["data"].attrs["env_args"] = json.dumps(args)
    with pytest.raises(
        ObjectLayoutError, match=r"lying.hdf5.*demo_0.*contradictory.*the relative pose says.*states says"
    ):
        Demonstrations(path)[0].object_poses("SquareNut")
    stated = "absolute-first" if version == "1.4.1" else "relative-first"
    assert Demonstrations(path, object_layout=stated)[0].object_layout() == stated
    assert issubclass(ObjectLayoutError, DatasetError)


def test_square_ph_is_absolute_first_by_all_witnesses(square_ph):
    demo = Demonstrations(square_ph)["demo_5"]
    block = demo.observation("object")
    assert find_in_states(block[:, :7], demo.states) == 10
    assert find_in_states(block[:, 7:], demo.states) is None
    eef = demo.eef_positions, demo.observation("robot0_eef_quat")
    assert order_from_relative_pose(block, *eef) == "absolute-first"
    assert order_from_relative_pose(np.roll(block, 7, axis=1), *eef) == "relative-first"
    assert demo.object_layout() == "absolute-first"


@pytest.mark.parametrize(
    ("env_name", "order"),
    [("NutAssemblySquare", "relative-first"), ("PickPlaceCan", "relative-first"), ("Lift", "absolute-first")],
)
def test_what_the_installed_robosuite_emits(env_name, order):
    """A later robosuite that reorders ``object`` once more would be noticed here."""
    suite = pytest.importorskip("robosuite")
    env = suite.make(env_name, robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False)
    rng = np.random.default_rng(0)
    observations, states = [env.reset()], [env.sim.get_state().flatten()]
    for _ in range(12):
        observations.append(env.step(rng.uniform(-0.5, 0.5, 7))[0])
        states.append(env.sim.get_state().flatten())
    env.close()
    block, eef_pos, eef_quat = (
        np.array([observation[key] for observation in observations])
        for key in ("object-state", "robot0_eef_pos", "robot0_eef_quat")
    )
    versions = {"env_version": suite.__version__, "eef_pos": eef_pos, "eef_quat_xyzw": eef_quat}
    assert detect_order(block, env_name, states=np.array(states), **versions) == order
