import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError
from ocplanner.files.records.render import RENDER_ATTRIBUTE
from ocplanner.policies.data import load_samples
from ocplanner.policies.transitions import load_transitions

CPU = torch.device("cpu")
NAMES = ["demo_0", "demo_10"]


@pytest.fixture
def changed(tiny_square, tmp_path):
    """``changed(edit, images=False)``: a copy of the synthetic data set with ``edit(group of demo_0)`` applied."""

    def make(edit, images: bool = False):
        path = tmp_path / "changed.hdf5"
        shutil.copy(tiny_square(images=images), path)
        with h5py.File(path, "a") as file:
            for name in NAMES:
                edit(file[f"data/{name}"])
        return path

    return make


def add_hint(demo, width: int = 7) -> None:
    steps = len(demo["actions"])
    demo["obs/ocp_hint"] = np.arange(steps * width, dtype=np.float32).reshape(steps, width)


def test_a_bc_batch_is_the_recorded_rows(changed, small):
    config = small(hint=(1,))
    with Demonstrations(changed(add_hint)) as demos:
        samples = load_samples(demos, NAMES, config)
        second = demos["demo_10"]
        seen, actions = samples.batch(np.array([90, 90 + 33]), config, CPU, None)
        assert seen.low_dim.shape == (2, 23)
        np.testing.assert_allclose(seen.low_dim[1, :14], second.observation("object")[33], rtol=1e-6)
        np.testing.assert_allclose(seen.low_dim[1, 14:17], second.observation("robot0_eef_pos")[33], rtol=1e-6)
        np.testing.assert_array_equal(seen.hint, second.observation("ocp_hint")[[0, 33]])
        np.testing.assert_allclose(actions[1], second.actions[33], rtol=1e-6)
        assert len(samples) == 180


def test_a_sequence_repeats_the_last_step_of_its_own_demonstration(tiny_square, small):
    config = small("bc-rnn")
    with Demonstrations(tiny_square()) as demos:
        samples = load_samples(demos, NAMES, config)
        seen, actions = samples.batch(np.array([87, 10, 179]), config, CPU, None)
        assert seen.low_dim.shape == (5, 3, 23)
        for column, (demo, rows) in enumerate(
            [("demo_0", [87, 88, 89, 89, 89]), ("demo_0", [10, 11, 12, 13, 14]), ("demo_10", [89] * 5)]
        ):
            np.testing.assert_allclose(actions[:, column], demos[demo].actions[rows], rtol=1e-6)
            np.testing.assert_allclose(seen.low_dim[:, column, :14], demos[demo].observation("object")[rows], rtol=1e-6)


def test_images_are_cropped_by_the_generator(tiny_square, small):
    config = small("bc-rnn", cameras=("agentview",))
    with Demonstrations(tiny_square(images=True)) as demos:
        samples = load_samples(demos, ["demo_0"], config)
        rows = np.array([3, 4])
        first, again, other = (
            samples.batch(rows, config, CPU, np.random.default_rng(seed))[0].images["agentview"] for seed in (0, 0, 1)
        )
        assert first.shape == (5, 2, 3, 76, 76)
        assert torch.equal(first, again)
        assert not torch.equal(first, other)


def test_a_batch_can_be_named(tiny_square, small):
    with Demonstrations(tiny_square()) as demos:
        samples = load_samples(demos, NAMES, small())
    assert samples.named(np.array([0, 89, 90, 179])) == "demo_0 step 0, demo_0 step 89, demo_10 step 0, demo_10 step 89"
    assert samples.named(np.arange(6)).endswith("step 3 and 2 more")


def test_the_digest_follows_the_numbers(changed, tiny_square, small):
    digests = set()
    for path in (tiny_square(), changed(lambda demo: demo["actions"].write_direct(np.zeros((90, 7))))):
        with Demonstrations(path) as demos:
            digests |= {load_samples(demos, names, small()).digest() for names in (NAMES, NAMES[:1], NAMES)}
    assert len(digests) == 4


def with_transitions(path, config, names):
    with Demonstrations(path) as demos:
        return (
            replace(load_samples(demos, names, config), transitions=load_transitions(demos, names, config)),
            demos[names[-1]].observation("object"),
            demos[names[-1]].rewards,
        )


@pytest.mark.parametrize("version", ["1.4.1", "1.5.1"])  # without and with next_obs
def test_transitions_lead_to_the_next_step(tiny_square, small, version):
    samples, recorded, rewards = with_transitions(tiny_square(version), small("bcq"), NAMES)
    batch = samples.transition_batch(np.array([90 + 33, 179]), small("bcq"), CPU, None)
    np.testing.assert_allclose(batch.observation.low_dim[0, :14], recorded[33], rtol=1e-6)
    np.testing.assert_allclose(batch.next_observation.low_dim[0, :14], recorded[34], rtol=1e-6)
    np.testing.assert_allclose(batch.next_observation.low_dim[1, :14], recorded[89], rtol=1e-6)
    assert batch.rewards.tolist() == [rewards[33], rewards[89]] == [0, 1]
    assert batch.dones.tolist() == [0, 1]


def test_the_files_next_observations_are_used(changed, small):
    """What was seen after the last step is there alone; and numbers are taken as they stand."""

    def add(demo):
        demo["next_obs/object"] = demo["obs/object"][:] + 5
        demo["next_obs/agentview_image"] = np.full((90, 84, 84, 3), 255, np.uint8)

    config = small("bcq", cameras=("agentview",))
    path = changed(add, images=True)
    samples, recorded, _ = with_transitions(path, config, NAMES)
    rows = np.array([90 + 33, 179, 89])
    batch = samples.transition_batch(rows, config, CPU, np.random.default_rng(0))
    np.testing.assert_allclose(batch.next_observation.low_dim[0, :14], recorded[33] + 5, rtol=1e-6)
    images = batch.next_observation.images["agentview"]
    assert bool((images[1:] == 1).all())
    following = samples.batch(rows + np.array([1, 0, 0]), config, CPU, None)[0].images["agentview"]
    assert torch.equal(images[0], following[0])


def test_next_observations_that_do_not_fit_are_refused(changed, small):
    def add(demo):
        demo["next_obs/object"] = demo["obs/object"][:, :-1]

    with pytest.raises(DatasetError, match=r"demo_0/next_obs/object: expected finite numbers of shape \(90, 14\)"):
        with_transitions(changed(add), small("bcq"), NAMES)

    def without_rewards(demo):  # which states could give
        del demo["rewards"], demo["states"]

    with pytest.raises(DatasetError, match="rewards"):
        with_transitions(changed(without_rewards), small("bcq"), NAMES)


def test_the_digest_follows_what_comes_after(changed, tiny_square, small):
    paths = [tiny_square(), changed(put("rewards", 3, 0.5))]
    assert len({with_transitions(path, small("bcq"), NAMES)[0].digest() for path in paths}) == 2
    assert len({with_transitions(path, small("bc"), NAMES)[0].actions.sum().item() for path in paths}) == 1


def put(key, place, value):
    def edit(demo):
        demo[key][place] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "settings", "message"),
    [
        (lambda demo: None, {"hint": (1,)}, "obs/ocp_hint: no hints in this data set; .*ocplanner label"),
        (add_hint, {"hint": (1, 5)}, "7 numbers a step, expected 13"),
        (put("obs/object", (4, 2), np.nan), {}, "demo_0/obs/object: not finite at step 4"),
        (put("obs/agentview_image", 4, 0), {"cameras": ("agentview",)}, "1 of 90 pictures are black, from step 4 on"),
        (lambda demo: demo.pop("obs/agentview_image"), {"cameras": ("agentview",)}, "no images of camera 'agentview'"),
    ],
)
def test_unusable_data_is_named(changed, small, edit, settings, message):
    with Demonstrations(changed(edit, images=True)) as demos, pytest.raises(DatasetError, match=message):
        load_samples(demos, NAMES, small(**settings))


def test_pictures_of_another_size_are_refused(changed, small):
    def shrink(demo):
        del demo["obs/agentview_image"]
        demo["obs/agentview_image"] = np.zeros((90, 64, 64, 3), dtype=np.uint8)

    with (
        Demonstrations(changed(shrink, images=True)) as demos,
        pytest.raises(DatasetError, match="64x64, expected 84x84"),
    ):
        load_samples(demos, NAMES, small(cameras=("agentview",)))


def test_pictures_of_manipulation_alone_are_refused_for_policies_that_see(changed, small):
    path = changed(lambda _: None, images=True)
    with h5py.File(path, "a") as file:
        file["data"].attrs[RENDER_ATTRIBUTE] = json.dumps({"frames": "manipulation", "cameras": ["agentview"]})
    with Demonstrations(path) as demos:
        load_samples(demos, NAMES, small())
        with pytest.raises(DatasetError, match=r"black before the grasp.*--frames all"):
            load_samples(demos, NAMES, small(cameras=("agentview",)))
