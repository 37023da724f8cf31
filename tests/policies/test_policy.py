import json
from dataclasses import MISSING
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load, save

from ocplanner import Policy
from ocplanner.errors import InvalidValueError, MismatchError, ModelFileError, ShapeError
from ocplanner.files.records.policy import PolicyHeader
from ocplanner.policies.network import make_network
from ocplanner.policies.observation import Observation
from ocplanner.policies.policy import save_policy
from ocplanner.settings import to_dict
from random_policy import header_of

FORMAT_1 = Path(__file__).parent / "format_1"
WIDTHS = {"object": 14, "robot0_eef_pos": 3, "robot0_eef_quat": 4, "robot0_gripper_qpos": 2}


@pytest.fixture
def saved(tmp_path, small):
    """``saved(algorithm, **settings)``: an untrained policy's file and its network."""

    def make(algorithm="bc", **settings):
        config = small(algorithm, **settings)
        actor = make_network(config, 23, 7).eval()
        path = tmp_path / "policy.safetensors"
        save_policy(actor, header_of(config), path)
        return path, actor

    return make


def seen(count: int = 2, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {key: rng.normal(size=(count, width)) for key, width in WIDTHS.items()}


def test_acting_draws_from_the_networks_mixture(saved):
    path, actor = saved()
    policy = Policy.load(path)
    observation = seen()
    action = policy.act(observation)
    assert (action.shape, action.dtype) == ((2, 7), np.float32)
    numbers = torch.from_numpy(np.concatenate(list(observation.values()), axis=1).astype(np.float32))
    means = actor.distribution(Observation(numbers, {}, None))[0].means.detach().numpy()
    assert np.abs(action[:, None] - means).max(-1).min(-1).max() < 1e-3


def test_an_episode_repeats_with_its_seed(saved):
    policy = Policy.load(saved("bc-rnn")[0])
    episodes = []
    for seed in (3, 3, 4):
        policy.reset(seed)
        episodes.append([policy.act(seen(seed=t)) for t in range(8)])
    np.testing.assert_array_equal(episodes[0], episodes[1])
    assert not np.array_equal(episodes[0], episodes[2])


def test_the_memory_lasts_as_long_as_a_training_sequence(saved):
    path, actor = saved("bc-rnn")
    policy = Policy.load(path)
    rows = [torch.from_numpy(np.concatenate(list(seen(seed=t).values()), axis=1).astype(np.float32)) for t in range(7)]
    means = []
    for part in (rows[:5], rows[5:]):  # a sequence has 5 steps
        mixture, _ = actor.distribution(Observation(torch.stack(part), {}, None))
        means += list(mixture.means.detach().numpy())
    for t in range(7):
        action = policy.act(seen(seed=t))
        assert np.abs(action[:, None] - means[t]).max(-1).min(-1).max() < 1e-3


def test_bcq_takes_of_its_proposals_the_one_that_its_first_critic_values_most(saved):
    path, actor = saved("bcq")
    policy = Policy.load(path)
    observation = seen()
    policy.reset(4)
    action = policy.act(observation)
    rows = torch.from_numpy(np.concatenate(list(observation.values()), axis=1).astype(np.float32))
    shown = Observation(rows, {}, None)
    noise = torch.randn(2, 8, 4, generator=torch.Generator().manual_seed(4))
    proposals = actor.sampler.propose(shown, noise)
    values = actor.critics.values(shown, proposals)[0]
    for i in range(2):
        np.testing.assert_array_equal(action[i], proposals[i, values[i].argmax()].detach().numpy())
    policy.reset(4)
    np.testing.assert_array_equal(policy.act(observation), action)
    assert not np.array_equal(policy.act(observation), action)


def test_images_and_hints_are_read(saved):
    policy = Policy.load(saved("bc-rnn", cameras=("agentview",), hint=(1,))[0])
    assert policy.observation_keys == (*WIDTHS, "agentview_image", "ocp_hint")
    observation = seen() | {"agentview_image": np.zeros((2, 84, 84, 3), np.uint8), "ocp_hint": np.zeros((2, 7))}
    assert policy.act(observation).shape == (2, 7)
    pushed = observation | {"ocp_hint": np.array([[9.0, 9, 9, 9, 9, 9, 1]] * 2)}
    policy.reset(0)
    np.testing.assert_array_equal(np.abs(policy.act(pushed)[:, :6]), 1)  # clipped


def test_wrong_observations_are_refused(saved):
    policy = Policy.load(saved(cameras=("agentview",))[0])
    with pytest.raises(MismatchError, match="missing: agentview_image"):
        policy.act(seen())
    with pytest.raises(ShapeError, match=r"expected uint8 \(B, 84, 84, 3\)"):
        policy.act(seen() | {"agentview_image": np.zeros((2, 84, 84, 3))})
    with pytest.raises(ShapeError, match=r"\(2, 24\), expected \(B, 23\)"):
        policy.act(seen() | {"object": np.zeros((2, 15)), "agentview_image": np.zeros((2, 84, 84, 3), np.uint8)})


def test_a_run_folder_stands_for_its_policy(saved, tmp_path):
    path, _ = saved()
    path.rename(tmp_path / "policy.safetensors")
    assert Policy.load(tmp_path).sha256 == Policy.load(tmp_path / "policy.safetensors").sha256
    (tmp_path / "empty").mkdir()
    with pytest.raises(ModelFileError, match=r"empty/policy\.safetensors: cannot be read"):
        Policy.load(tmp_path / "empty")


def test_files_that_are_no_policies_are_refused(saved, tmp_path):
    path, _ = saved()
    content = path.read_bytes()
    with pytest.raises(ModelFileError, match="cannot be read"):
        Policy.load(tmp_path / "absent.safetensors")
    faults = {
        "truncated": content[: len(content) // 2],
        "empty": b"",
        "text": b"not a policy at all",
        "planner": content.replace(b'\\"kind\\": \\"policy\\"', b'\\"kind\\": \\"plaice\\"'),
        "other sizes": content.replace(b'\\"lstm_hidden\\": 16', b'\\"lstm_hiddem\\": 16'),
    }
    for fault, data in faults.items():
        assert data != content, fault
        path.write_bytes(data)
        with pytest.raises(ModelFileError, match="is no policy file"):
            Policy.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hidden": [10**9, 10**9]}, "by its configuration"),
        ({"hidden": [10**12]}, "by its configuration"),
        ({"hidden": [8] * 10**5}, "more layers"),
        ({"lstm_layers": 10**9}, "more layers"),
    ],
)
def test_sizes_are_checked_before_memory_is_taken(tmp_path, small, change, message):
    config = small("bc")
    training = to_dict(config)
    training["network"] |= change
    path = tmp_path / "policy.safetensors"
    save_policy(make_network(config, 23, 7), header_of(config, training=training), path)
    with pytest.raises(ModelFileError, match=message):
        Policy.load(path)


@pytest.mark.parametrize(
    ("algorithm", "expected"),
    [
        ("bc-rnn", [1.0, 0.7624, 1.0, 0.894, 1.0, 1.0, -0.1382]),
        ("bcq", [-0.5104, -0.9998, -0.9467, 1.0, -0.568, -0.9643, -0.9998]),
    ],
)
def test_files_of_format_1_act_as_they_did(algorithm, expected):
    """Trained for two steps, and asked for five actions, by the last version that wrote this format."""
    policy = Policy.load(FORMAT_1 / f"{algorithm}.safetensors")
    assert (policy.header.task, policy.header.robots, policy.header.step) == ("Square", ("Panda",), 2)
    rng = np.random.default_rng(0)
    policy.reset(3)
    for _ in range(5):
        action = policy.act({key: rng.uniform(size=(1, width)) for key, width in (WIDTHS | {"ocp_hint": 13}).items()})
    np.testing.assert_allclose(action[0], expected, atol=1e-3)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused(small, tmp_path, value):
    config = small("bc")
    actor = make_network(config, 23, 7).eval()
    with torch.no_grad():
        next(iter(actor.parameters())).view(-1)[3] = value
    save_policy(actor, header_of(config), tmp_path / "policy.safetensors")
    with pytest.raises(ModelFileError, match=r"policy\.safetensors.* holds NaN or infinity"):
        Policy.load(tmp_path / "policy.safetensors")


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_observations_that_are_not_finite_are_refused_and_forgotten(saved, value):
    policy = Policy.load(saved("bc-rnn")[0])
    policy.act(seen(seed=1))
    expected = policy.act(seen(seed=2))
    policy.reset(0)
    policy.act(seen(seed=1))
    wrong = seen(seed=5)
    wrong["robot0_eef_pos"][1, 2] = value
    with pytest.raises(InvalidValueError, match="observation robot0_eef_pos holds NaN or infinity in row 1"):
        policy.act(wrong)
    np.testing.assert_array_equal(policy.act(seen(seed=2)), expected)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5])
def test_seeds_of_an_episode_are_checked(saved, seed):
    with pytest.raises(InvalidValueError, match=f"seed is {seed}"):
        Policy.load(saved()[0]).reset(seed)


def test_a_header_that_lacks_a_field_names_it(saved):
    path, _ = saved()
    content = path.read_bytes()
    size = int.from_bytes(content[:8], "little")
    found = json.loads(content[8 : 8 + size])["__metadata__"]["ocplanner"]
    for name, field in PolicyHeader.__dataclass_fields__.items():
        if field.default is MISSING and field.default_factory is MISSING:
            config = json.loads(found)["config"]
            del config[name]
            save_with(path, content, {**json.loads(found), "config": config})
            with pytest.raises(ModelFileError, match=f"{name} is missing"):
                Policy.load(path)


def save_with(path: Path, content: bytes, told: dict) -> None:
    path.write_bytes(save(load(content), metadata={"ocplanner": json.dumps(told)}))
