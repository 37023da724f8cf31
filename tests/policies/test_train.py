import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, MismatchError, OutputError, TrainingError
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, LabelRecord
from ocplanner.files.storage import locked
from ocplanner.policies import train
from ocplanner.policies.data import Samples
from ocplanner.policies.policy import Policy
from ocplanner.policies.q_values import q_values
from ocplanner.policies.train import train_policy
from ocplanner.settings import build, to_dict
from ocplanner.training.run_folder import RunFolder


def differing(first, second) -> set[str]:
    a, b = load_file(first), load_file(second)
    assert a.keys() == b.keys()
    return {name for name in a if not torch.equal(a[name], b[name])}


def test_a_run_folder_holds_everything(tiny_square, tmp_path, small):
    config = small("bc-rnn")
    policy = train_policy(config, tiny_square(), tmp_path / "run")
    folder = policy.parent
    assert {p.name for p in folder.iterdir()} == {
        "config.yaml", "metrics.jsonl", "tensorboard", "checkpoints", "policies", "policy.safetensors"
    }  # fmt: skip
    assert sorted(p.name for p in (folder / "policies").iterdir()) == [
        "step_0000010.safetensors", "step_0000020.safetensors"
    ]  # fmt: skip
    assert differing(policy, folder / "policies" / "step_0000020.safetensors") == set()
    rows = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [5, 10, 15, 20]
    for row in rows:
        assert row["steps_per_second"] > 0
        assert np.isfinite([row["loss"], row["valid_loss"]]).all()
    assert list((folder / "tensorboard").glob("events*"))
    loaded = Policy.load(policy)
    assert loaded.training == config
    header = loaded.header
    assert header.training == to_dict(config)
    assert (header.task, header.robots, header.object_layout) == ("Square", ("Panda",), "absolute-first")
    assert (header.algorithm, header.step, header.seed) == ("bc-rnn", 20, 0)


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_losses_fall(tiny_square, tmp_path, small, algorithm):
    config = small(algorithm, steps=300, validate_every=100, save_every=300, learning_rate=5e-3)
    train_policy(config, tiny_square(), tmp_path / "run")
    rows = RunFolder(tmp_path / "run").rows()
    assert rows[-1].values["loss"] < rows[0].values["loss"] - 5
    assert rows[-1].values["valid_loss"] < rows[0].values["valid_loss"]


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_rounded_products_learn_as_exact_ones_do(tiny_square, tmp_path, small, algorithm):
    config = small(algorithm, steps=300, validate_every=100, save_every=300, learning_rate=5e-3)
    rounded = replace(config, precision="bfloat16")
    policies = [train_policy(c, tiny_square(), tmp_path / c.precision) for c in (config, rounded)]
    exact_rows, rows = (RunFolder(policy.parent).rows() for policy in policies)
    assert rows[0].values["loss"] != exact_rows[0].values["loss"]
    assert rows[0].values["loss"] == pytest.approx(exact_rows[0].values["loss"], abs=0.5)
    assert rows[-1].values["loss"] == pytest.approx(exact_rows[-1].values["loss"], abs=2.0)
    assert all(tensor.dtype != torch.bfloat16 for tensor in load_file(policies[1]).values())


@pytest.mark.parametrize(("ema", "seconds"), [(0.0, 30.0), (0.9, 30.0), (0.9, 0.0)])
@pytest.mark.parametrize(
    ("algorithm", "cameras"),
    [("bc", ()), ("bc-rnn", ()), ("bc", ("agentview",)), ("bcq", ()), ("bcq", ("agentview",))],
)
def test_a_killed_training_continues_to_the_same_weights(
    tiny_square, tmp_path, monkeypatch, killed, small, algorithm, cameras, ema, seconds
):
    monkeypatch.setattr(train, "_CHECKPOINT_SECONDS", seconds)  # 0: after every step
    config = small(algorithm, cameras=cameras, ema=ema)
    data = tiny_square(images=bool(cameras))
    whole = train_policy(config, data, tmp_path / "whole")
    with killed("batch", 13):
        train_policy(config, data, tmp_path / "killed")
    _, facts = RunFolder(tmp_path / "killed").load("latest")
    assert facts["step"] == (10 if seconds else 13)
    resumed = train_policy(config, data, tmp_path / "killed")
    for name in ("policy.safetensors", "policies/step_0000010.safetensors", "policies/step_0000020.safetensors"):
        assert differing(tmp_path / "whole" / name, tmp_path / "killed" / name) == set()
    assert differing(whole, resumed) == set()
    timing = {"seconds", "steps_per_second"}
    seen = [
        [replace(row, values={key: row.values[key] for key in row.values.keys() - timing}) for row in rows]
        for rows in (RunFolder(policy.parent).rows() for policy in (whole, resumed))
    ]
    assert seen[0] == seen[1]


@pytest.mark.parametrize("sampler", ["vae", "gmm"])
def test_bcq_learns_which_actions_were_rewarded(rewarded, tmp_path, small, sampler):
    """One step of reward for actions to the right: the policy then goes right, though half of the data went left."""
    config = small("bcq", steps=600, validate_every=100, save_every=600, learning_rate=3e-3)
    changes = {"critic_learning_rate": 3e-3, "sampler": sampler} | ({"kl_weight": 0.01} if sampler == "vae" else {})
    config = replace(config, algorithm_settings=replace(config.algorithm_settings, **changes))
    path = train_policy(config, rewarded, tmp_path / "run")
    rows = RunFolder(tmp_path / "run").rows()
    parts = ("vae_reconstruction", "critic_loss") if sampler == "vae" else ("critic_loss",)
    for name in (*parts, *(f"valid_{part}" for part in parts)):
        assert rows[-1].values[name] < 0.5 * rows[0].values[name], name
    if sampler == "vae":
        assert rows[-1].values["kl"] > 0.1
    assert 0.3 < rows[-1].values["valid_mean_q"] < 0.7  # half of the actions are worth 1, the others 0
    policy = Policy.load(path)
    with Demonstrations(rewarded) as demos:
        demo = demos["demo_2"]
        q, right = q_values(policy, demos, "demo_2"), demo.rewards == 1
        assert q.shape == (2, demo.length)
        assert q[:, right].min() > q[:, ~right].max()
        seen = {key: demo.observation(key) for key in policy.observation_keys}
        assert (policy.act(seen)[:, 0] > 0.4).mean() > 0.9


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_a_hint_that_is_the_action_is_learned_from(tiny_square, tmp_path, small, algorithm):
    """Recorded actions as hints 1 step ahead, noise as hints 5 ahead: weights that use the one lower the loss."""
    data = tmp_path / "labelled.hdf5"
    shutil.copy(tiny_square(), data)
    rng = np.random.default_rng(0)
    with h5py.File(data, "a") as file:
        for demo in file["data"].values():
            actions = rng.uniform(-1, 1, demo["actions"].shape)  # nothing that is seen predicts them but the hint
            demo["actions"][:] = actions
            parts = [actions[:, :6], rng.normal(size=(len(actions), 6)), np.ones((len(actions), 1))]
            demo["obs/ocp_hint"] = np.concatenate(parts, axis=1).astype(np.float32)
    losses = {}
    for hint in (None, (1, 5)):
        settings = {"steps": 400, "validate_every": 400, "save_every": 400, "learning_rate": 5e-3}
        run = tmp_path / f"run_{hint is not None}"
        train_policy(small(algorithm, hint, **settings), data, run)
        losses[hint] = RunFolder(run).rows()[-1].values["valid_loss"]
    assert losses[(1, 5)] < losses[None] - 3


def test_the_labels_travel_with_the_policy_and_must_fit_it(tiny_square, tmp_path, small):
    data = tmp_path / "labelled.hdf5"
    shutil.copy(tiny_square(), data)
    labels = {"planner_sha256": "ab12", "settings": {"horizon_steps": [5], "hint_from": "object"}}
    with h5py.File(data, "a") as file:
        file["data"].attrs[LABEL_ATTRIBUTE] = json.dumps(labels)
        for demo in file["data"].values():
            demo["obs/ocp_hint"] = np.zeros((len(demo["actions"]), 7), dtype=np.float32)
    with pytest.raises(MismatchError, match=r"hints \(5,\) steps ahead, the policy reads \(1,\); give horizons 5"):
        train_policy(small(hint=(1,)), data, tmp_path / "run")
    hinted = Policy.load(train_policy(small(hint=()), data, tmp_path / "hinted"))
    assert hinted.header.labels == build(LabelRecord, labels)
    assert hinted.training == small(hint=(5,))
    assert Policy.load(train_policy(small(), data, tmp_path / "plain")).header.labels is None


def test_hints_that_nobody_labelled_need_their_horizons(tiny_square, tmp_path, small):
    data = tmp_path / "hints.hdf5"
    shutil.copy(tiny_square(), data)
    with h5py.File(data, "a") as file:
        for demo in file["data"].values():
            demo["obs/ocp_hint"] = np.zeros((len(demo["actions"]), 7), dtype=np.float32)
    with pytest.raises(MismatchError, match="does not say which horizons its hints have"):
        train_policy(small(hint=()), data, tmp_path / "run")
    assert Policy.load(train_policy(small(hint=(3,)), data, tmp_path / "run")).training == small(hint=(3,))


def test_a_finished_run_is_not_trained_again(tiny_square, tmp_path, monkeypatch, small):
    first = load_file(train_policy(small(), tiny_square(), tmp_path / "run"))
    monkeypatch.setattr(train._Training, "_step", lambda *_: pytest.fail("trained again"))
    second = load_file(train_policy(small(), tiny_square(), tmp_path / "run"))
    assert all(torch.equal(first[name], second[name]) for name in first)


@pytest.mark.parametrize("algorithm", ["bc-rnn", "bcq"])
def test_two_processes_train_as_one_does(tiny_square, tmp_path, small, algorithm):
    config = small(algorithm, hint=None, schedule="constant", warmup=0, steps=10, save_every=10)
    one = load_file(train_policy(config, tiny_square(), tmp_path / "one"))
    two = load_file(train_policy(config, tiny_square(), tmp_path / "two", processes=2))
    for name, value in one.items():
        torch.testing.assert_close(two[name], value, rtol=1e-3, atol=1e-5)
    rows = [RunFolder(tmp_path / run).rows() for run in ("one", "two")]
    for a, b in zip(*rows, strict=True):
        assert a.values["loss"] == pytest.approx(b.values["loss"], rel=1e-4)


def test_an_error_reaches_the_user_from_two_processes(tiny_square, tmp_path, small):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.yaml").write_text("seed: 5\n")
    with pytest.raises(TrainingError, match="belongs to another training"):
        train_policy(small(), tiny_square(), tmp_path / "run", processes=2)


def test_a_loss_that_is_not_finite_names_step_and_batch(tiny_square, tmp_path, monkeypatch, small):
    original, calls = Samples.batch, []

    def batch(self, rows, config, device, rng):
        seen, actions = original(self, rows, config, device, rng)
        calls.append(rng is not None)
        return seen, actions * float("nan") if sum(calls) == 8 else actions

    monkeypatch.setattr(Samples, "batch", batch)
    with pytest.raises(TrainingError, match=r"loss is nan at step 8, batch: demo_\d+ step \d+, .* and 12 more; lower"):
        train_policy(small(), tiny_square(), tmp_path / "run")


def test_a_critic_that_runs_away_is_named(tiny_square, tmp_path, small):
    data = tmp_path / "rewarded.hdf5"
    shutil.copy(tiny_square(), data)
    with h5py.File(data, "a") as file:
        file["data/demo_0/rewards"][:] = 1e30  # its square is beyond a float32
    with pytest.raises(TrainingError, match=r"the loss is inf at step 1, batch: demo_\d+ step \d+"):
        train_policy(small("bcq"), data, tmp_path / "run")


def test_another_configuration_or_other_data_in_the_folder_is_refused(tiny_square, tmp_path, small):
    train_policy(small(), tiny_square(), tmp_path / "run")
    with pytest.raises(TrainingError, match=r"seed was 0, is 1.*another --run"):
        train_policy(small(seed=1), tiny_square(), tmp_path / "run")
    with pytest.raises(TrainingError, match=r"data was 270 steps"):
        train_policy(small(), tiny_square("1.5.1"), tmp_path / "run")


def test_a_folder_in_use_is_refused(tiny_square, tmp_path, small):
    with locked(tmp_path / "run"), pytest.raises(OutputError, match="another process"):
        train_policy(small(), tiny_square(), tmp_path / "run")


def test_the_learning_rate_follows_its_schedule(small):
    constant = small(learning_rate=1e-3, schedule="constant", warmup=0)
    assert {constant.rate(step) for step in range(20)} == {1e-3}
    cosine = replace(constant, schedule="cosine", warmup=4)
    values = [cosine.rate(step) for step in range(20)]
    assert values[0] == pytest.approx(0.25e-3)
    assert max(values) < 1e-3
    assert values[4:] == sorted(values[4:], reverse=True)
    assert cosine.rate(20) == pytest.approx(0)


def test_a_file_without_masks_is_trained_on_whole(tiny_square, small, tmp_path, capsys):
    path = tmp_path / "unmasked.hdf5"
    path.write_bytes(tiny_square().read_bytes())
    with h5py.File(path, "r+") as file:
        del file["mask"]
    found = train.read(small(), path)
    assert len(found.train.names) == 4
    assert found.valid is None
    assert "has no masks: training on every demonstration" in capsys.readouterr().err
    with pytest.raises(DatasetError, match="no such mask"):
        train.read(small(mask="mine"), path)
