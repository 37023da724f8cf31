import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from ocplanner.errors import OutputError, TrainingError
from ocplanner.files.records.metrics import StepMetrics
from ocplanner.files.storage import locked
from ocplanner.planner.frames import CameraFrames
from ocplanner.planner.planner import Planner
from ocplanner.planner.stages import PredictorStage
from ocplanner.planner.train import train_on_frames
from ocplanner.training.run_folder import RunFolder


class Killed(BaseException):
    """Stands for a kill: nothing in the library catches it."""


def weights(path) -> dict[str, torch.Tensor]:
    return load_file(path)


def test_a_run_folder_holds_everything(frames, tmp_path, tiny, settings):
    planner = train_on_frames(tiny(), *frames, settings, tmp_path / "run")
    assert planner == tmp_path / "run" / "planner.safetensors"
    assert {"config.yaml", "metrics.jsonl", "tensorboard", "checkpoints"} <= {p.name for p in planner.parent.iterdir()}
    rows = [json.loads(line) for line in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
    assert [row["stage"] for row in rows if "step" in row] == ["vae"] * 4 + ["predictor"] * 2 + ["finetune"] * 2
    final = [row for row in rows if row["stage"] == "final"]
    assert {(row["candidate"], row["appearance"]) for row in final} == {
        (candidate, appearance)
        for candidate in ("predictor", "finetune")
        for appearance in ("source", "IIWA", "Kinova3")
    }
    assert len({row["candidate"] for row in final if row["kept"]}) == 1
    assert Planner.load(planner).header.training.held_out["source"]["ade_mm"] > 0
    assert planner.stat().st_mode == (tmp_path / "run" / "config.yaml").stat().st_mode


def test_the_visual_preset_of_the_images_travels_with_the_planner(frames, tmp_path, tiny, settings):
    planner = train_on_frames(tiny(), *frames, settings._replace(visual="stock"), tmp_path / "run")
    assert Planner.load(planner).header.visual == "stock"


def test_losses_fall(frames, tmp_path, tiny, settings):
    config = tiny()
    config = replace(
        config,
        vae=replace(config.vae, steps=150, learning_rate=1e-2),
        predictor=replace(config.predictor, steps=100, learning_rate=3e-3),
        validate_every=50,
    )
    train_on_frames(config, *frames, settings, tmp_path / "run")
    rows = RunFolder(tmp_path / "run").rows()
    for stage, factor in (("vae", 0.5), ("predictor", 0.9)):
        losses = [row.values["loss"] for row in rows if isinstance(row, StepMetrics) and row.stage == stage]
        assert losses[-1] < factor * losses[0]


@pytest.mark.parametrize("killed_at", [("vae", 13), ("predictor", 7), ("finetune", 3)])
def test_a_killed_training_continues_to_the_same_weights(frames, tmp_path, monkeypatch, killed_at, tiny, settings):
    import ocplanner.planner.stages as stages

    config = tiny()
    whole = train_on_frames(config, *frames, settings, tmp_path / "whole")
    kind = next(kind for kind in stages.STAGES if kind.name == killed_at[0])
    original, calls = kind.loss, []

    def loss(self, rows, rng):
        calls.append(1)
        if len(calls) > killed_at[1]:
            raise Killed
        return original(self, rows, rng)

    with monkeypatch.context() as patch:
        patch.setattr(kind, "loss", loss)
        with pytest.raises(Killed):
            train_on_frames(config, *frames, settings, tmp_path / "killed")
    resumed = train_on_frames(config, *frames, settings, tmp_path / "killed")
    expected, found = weights(whole), weights(resumed)
    assert expected.keys() == found.keys()
    assert {name for name in expected if not torch.equal(expected[name], found[name])} == set()
    for row, again in zip(*(RunFolder(tmp_path / run).rows() for run in ("whole", "killed")), strict=True):
        assert replace(row, values={}) == replace(again, values={})
        assert row.values.keys() == again.values.keys()
        for key in row.values.keys() - {"seconds", "loss"}:  # the loss is a mean since the last validation or the stop
            assert row.values[key] == pytest.approx(again.values[key], rel=1e-6)


def test_a_finished_run_is_not_trained_again(frames, tmp_path, monkeypatch, tiny, settings):
    config = tiny()
    first = weights(train_on_frames(config, *frames, settings, tmp_path / "run"))
    monkeypatch.setattr(PredictorStage, "loss", lambda *_: pytest.fail("trained again"))
    second = weights(train_on_frames(config, *frames, settings, tmp_path / "run"))
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_another_configuration_in_the_folder_is_refused(frames, tmp_path, tiny, settings):
    train_on_frames(tiny(), *frames, settings, tmp_path / "run")
    with pytest.raises(TrainingError, match=r"seed was 0, is 1.*another --run"):
        train_on_frames(tiny(seed=1), *frames, settings, tmp_path / "run")


def test_other_data_in_the_folder_is_refused(frames, tmp_path, tiny, settings):
    train_on_frames(tiny(), *frames, settings, tmp_path / "run")
    train, valid = frames
    with pytest.raises(TrainingError, match=r"data\.train was"):
        train_on_frames(tiny(), train.take(np.arange(60)), valid, settings, tmp_path / "run")


def test_threads_may_change(frames, tmp_path, tiny, settings):
    train_on_frames(tiny(), *frames, settings, tmp_path / "run")
    train_on_frames(tiny(threads=2), *frames, settings, tmp_path / "run")


def test_a_damaged_checkpoint_is_named(frames, tmp_path, tiny, settings):
    train_on_frames(tiny(), *frames, settings, tmp_path / "run")
    latest = tmp_path / "run" / "checkpoints" / "latest.safetensors"
    latest.write_bytes(latest.read_bytes()[:100])
    with pytest.raises(TrainingError, match=r"latest\.safetensors is damaged"):
        train_on_frames(tiny(), *frames, settings, tmp_path / "run")


def test_nan_names_the_stage_and_step(frames, tmp_path, tiny, settings):
    train, valid = frames
    poisoned = replace(train, positions=np.where(train.demonstration[:, None, None] == 2, np.nan, train.positions))
    config = tiny()
    with pytest.raises(TrainingError, match=r"vae loss is nan at step 1"):
        train_on_frames(config, poisoned, valid, settings, tmp_path / "run")


def test_two_trainings_in_one_folder_exclude_each_other(frames, tmp_path, tiny, settings):
    with locked(tmp_path / "run"), pytest.raises(OutputError, match="another process"):
        train_on_frames(tiny(), *frames, settings, tmp_path / "run")


def test_seeds_give_different_weights_and_equal_seeds_equal_ones(frames, tmp_path, tiny, settings):
    config = tiny(finetune=replace(tiny().finetune, steps=0))
    runs = [
        train_on_frames(replace(config, seed=s), *frames, settings, tmp_path / n)
        for s, n in ((0, "a"), (0, "b"), (1, "c"))
    ]
    a, b, c = (weights(path)["predictor.0.weight"] for path in runs)
    assert torch.equal(a, b)
    assert not torch.equal(a, c)


@pytest.mark.parametrize("observe", ["full", "no-robot"])
@pytest.mark.parametrize("loss", ["l2", "kl"])
def test_plain_images_and_both_latent_losses(frames, tmp_path, observe, loss, tiny, settings):
    plain = []
    for part in frames:
        camera = CameraFrames(part.cameras["agentview"].scene)
        plain.append(replace(part, cameras={"agentview": camera}))
    base = tiny()
    config = replace(base, observe=observe, loss=replace(base.loss, latent=loss))
    settings = settings._replace(mask_rgb=None)
    found = Planner.load(train_on_frames(config, *plain, settings, tmp_path / "run")).header
    assert found.observe == observe
    assert found.mask_rgb is None


def test_position_planner(frames, tmp_path, tiny, settings):
    base = tiny()
    config = replace(base, network=replace(base.network, outputs="position"))
    path = train_on_frames(config, *frames, settings, tmp_path / "run")
    found = Planner.load(path).header
    assert found.outputs == "position"
    assert load_file(path)["decoder.head.weight"].shape == (3, 16)
    assert "rotation_deg" not in found.training.held_out["source"]
