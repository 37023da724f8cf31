import numpy as np
import pytest

from ocplanner import Demonstrations, Policy
from ocplanner.errors import DatasetError, MismatchError, ModelFileError
from ocplanner.policies.hint_use import hint_use
from ocplanner.report.policy_figures import draw_policies, hint_share_figure, hint_use_figure, policy_name
from random_policy import HELD, random_training, write_labelled, write_random_policy


@pytest.fixture
def labelled(tiny_square, tmp_path):
    return write_labelled(tiny_square(), tmp_path / "labelled.hdf5")


def lines_of(axes) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_ydata() for line in axes.lines if not line.get_label().startswith("_")}


def test_weights_hint_and_residual_are_drawn_and_the_held_span_is_shaded(labelled, tmp_path):
    policy = Policy.load(write_random_policy(tmp_path / "policy.safetensors", labelled, random_training()))
    with Demonstrations(labelled) as demos:
        use = hint_use(policy, demos, "demo_2")
    weights, *parts = hint_use_figure(use, "title").axes
    for part, letter in enumerate(("x, position", "y, rotation")):
        shown = lines_of(weights)[letter]
        np.testing.assert_array_equal(np.isfinite(shown), use.held)
        np.testing.assert_allclose(shown[HELD], use.weights[HELD, 0, part])
        lines = lines_of(parts[part])
        np.testing.assert_allclose(lines["|residual A|"], use.residual_size[:, part])
        np.testing.assert_allclose(lines["|hint|"][HELD], np.linalg.norm(use.hint[HELD, 0, part], axis=-1))
        assert np.isnan(lines["|hint|"][~use.held]).all()
        assert f"{100 * use.share[part]:.0f} %" in parts[part].get_title("right")
    for axes in (weights, *parts):
        (span,) = axes.patches
        assert (span.get_x(), span.get_x() + span.get_width()) == (HELD.start - 0.5, HELD.stop - 0.5)


def test_each_policy_with_a_hint_is_drawn_on_a_held_out_demonstration(labelled, tiny_square, tmp_path):
    other = write_labelled(tiny_square(), tmp_path / "other.hdf5", (1, 10))
    files = [
        write_random_policy(tmp_path / "k5" / "policies" / "step_20.safetensors", labelled, random_training()),
        write_random_policy(tmp_path / "many" / "policy.safetensors", other, random_training("bc-rnn", (1, 10))),
        write_random_policy(tmp_path / "plain" / "policy.safetensors", labelled, random_training(hint=None)),
    ]
    written = draw_policies(files, [labelled, other], tmp_path / "figures")
    assert [path.name for path in written] == ["hint_use_k5_step_20.png", "hint_use_many.png"]
    assert all(path.stat().st_size > 5000 for path in written)
    with pytest.raises(MismatchError, match=r"labelled\.hdf5 has hints 5 steps .*many.* learned from hints 1, 10"):
        draw_policies(files, [labelled], tmp_path / "figures")


def test_the_title_says_what_was_held_out(labelled, tmp_path, monkeypatch):
    titles = []
    draw = hint_use_figure
    monkeypatch.setattr(
        "ocplanner.report.policy_figures.hint_use_figure", lambda use, title: titles.append(title) or draw(use, title)
    )
    file = write_random_policy(tmp_path / "policy.safetensors", labelled, random_training())
    draw_policies([file], [labelled], tmp_path)
    assert titles == ["BC, state, hint k = 5 from the object, step 20: demo_2 (held out)"]


def test_a_run_is_followed_through_its_checkpoints(labelled, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "ocplanner.report.policy_figures.hint_share_figure",
        lambda *arguments: drawn.append(arguments) or hint_share_figure(*arguments),
    )
    steps = (20, 40)
    files = [
        write_random_policy(
            tmp_path / "run" / "policies" / f"step_{step}.safetensors", labelled, random_training(seed=step), step
        )
        for step in steps
    ]
    assert len(draw_policies(files[:1], [labelled], tmp_path / "figures")) == 1  # not the last of its run
    written = draw_policies(files[1:], [labelled], tmp_path / "figures")
    assert [path.name for path in written] == ["hint_use_run_step_40.png", "hint_share_run_step_40.png"]
    ((shown, shares, title),) = drawn
    assert shown == [20, 40]
    with Demonstrations(labelled) as demos:
        expected = [hint_use(Policy.load(file), demos, "demo_2").share for file in files]
    np.testing.assert_allclose(shares, expected)
    assert title == "BC, state, hint k = 5 from the object: 1 episode (held out)"


def test_what_cannot_be_drawn_is_an_error(labelled, tiny_square, tmp_path):
    file = write_random_policy(tmp_path / "policy.safetensors", labelled, random_training())
    never = write_labelled(tiny_square(), tmp_path / "never.hdf5", held=False)
    with pytest.raises(DatasetError, match="held in none"):
        draw_policies([file], [never], tmp_path)
    file.write_bytes(b"damaged")
    with pytest.raises(ModelFileError, match="no policy file"):
        draw_policies([file], [labelled], tmp_path)


def test_policies_go_by_their_runs(tmp_path):
    names = ("run/policy.safetensors", "run/policies/step_20.safetensors", "kept/best.safetensors")
    assert [policy_name(tmp_path / name) for name in names] == ["run", "run_step_20", "best"]
