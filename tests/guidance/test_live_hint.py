"""Hints made live against those that ``ocplanner label`` writes."""

from dataclasses import replace

import numpy as np
import pytest

from ocplanner.collection.render import render_dataset
from ocplanner.collection.settings import RenderSettings
from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.demos.dataset import Demonstrations
from ocplanner.envs import make_env
from ocplanner.errors import MismatchError
from ocplanner.files.records.labels import ActionScale, LabelRecord
from ocplanner.guidance.dataset import label_dataset
from ocplanner.guidance.live_hint import LiveHint
from ocplanner.guidance.settings import LabelSettings
from ocplanner.planner.planner import Planner
from random_planner import write_random_planner


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = tmp_path_factory.mktemp("planner") / "planner.safetensors"
    write_random_planner(path)
    return Planner.load(path)


@pytest.fixture(scope="module")
def images(square_ph, tmp_path_factory):
    path = tmp_path_factory.mktemp("images") / "images.hdf5"
    return render_dataset(square_ph, path, RenderSettings(silhouettes=()), limit=1)


@pytest.fixture(scope="module", params=["object", "plan"])
def labelled(request, images, planner):
    settings = LabelSettings(horizon_steps=(1, 4), hint_from=request.param)
    return label_dataset(images, images.with_name(f"{request.param}.hdf5"), planner, settings)


def test_the_same_states_give_the_same_hints(labelled, planner):
    with Demonstrations(labelled) as demos, make_env("Square", "Panda", cameras=()) as env:
        demo, hint = demos[0], LiveHint(env, planner, demos.label_record)
        states, actions, recorded = demo.states, demo.actions, demo.observation("ocp_hint")
        hold, last, flags = GraspDetector(), -1.0, 0
        for row in range(demo.length):
            env.set_state(states[row])
            held = hold.update(env.object_pose(), env.eef_pose().position, last)
            live = hint.row(held, {})
            np.testing.assert_allclose(live, recorded[row], atol=1e-5, err_msg=f"step {row}")
            flags += live[-1] > 0
            last = actions[row, -1]
        assert flags > 30


def test_pictures_drawn_already_are_used(labelled, planner):
    with Demonstrations(labelled) as demos, make_env("Square", "Panda", cameras=()) as env:
        hint, states = LiveHint(env, planner, demos.label_record), demos[0].states
        recorded = demos[0].observation("ocp_hint")
        row = int(np.flatnonzero(recorded[:, -1])[0])
        env.set_state(states[row])
        picture = env.render("agentview", 84, 84, "masked")
        env.render = None  # type: ignore[method-assign]
        live = hint.row(True, {("agentview", 84, "masked"): picture})
        np.testing.assert_allclose(live, recorded[row], atol=1e-5)


def test_refuses_another_planner_task_or_preset(planner):
    settings = {"horizon_steps": [1], "hint_from": "object"}
    labels = LabelRecord(planner.sha256, settings, action_frame="world", action_scale=ActionScale(0.05, 0.5))
    with make_env("Square", "Panda", cameras=()) as env, pytest.raises(MismatchError, match="is not the planner"):
        LiveHint(env, planner, replace(labels, planner_sha256="0" * 64))
    with make_env("Lift", "Panda", cameras=()) as env, pytest.raises(MismatchError, match="plans for Square"):
        LiveHint(env, planner, labels)
    stock = make_env("Square", "Panda", cameras=(), visual="stock")
    with stock as env, pytest.raises(MismatchError, match="drawn as stock"):
        LiveHint(env, planner, labels)


@pytest.mark.parametrize(
    ("origin", "steps", "decoded"), [("object", (1,), 1), ("object", (4, 2), 4), ("plan", (1,), 2)]
)
def test_no_more_of_a_plan_is_decoded_than_the_hint_reads(planner, monkeypatch, origin, steps, decoded):
    settings = {"horizon_steps": list(steps), "hint_from": origin}
    labels = LabelRecord(planner.sha256, settings, action_frame="world", action_scale=ActionScale(0.05, 0.5))
    plan, asked = planner.plan, []
    monkeypatch.setattr(planner, "plan", lambda images, threads=1, steps=None: asked.append(steps) or plan(images))
    with make_env("Square", "Panda", cameras=()) as env:
        LiveHint(env, planner, labels).row(True, {})
    assert asked == [decoded]


def test_labels_without_hints_are_refused(planner):
    with make_env("Square", "Panda", cameras=()) as env, pytest.raises(MismatchError, match="has no hints"):
        LiveHint(env, planner, LabelRecord(planner.sha256, {"hints": False, "reward": "only"}))
