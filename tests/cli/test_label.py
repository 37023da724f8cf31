import tyro

from ocplanner.cli import main
from ocplanner.cli.label import Label
from ocplanner.demos.dataset import Demonstrations
from ocplanner.guidance.rewards import RewardConfig
from ocplanner.guidance.settings import LabelSettings
from random_planner import write_random_planner


def test_flags():
    flags = "--planner p --horizon-step 1 5 --reward only --form exp --no-hints --threads 2"
    parsed = tyro.cli(Label, args=["d.hdf5", "o.hdf5", *flags.split()])
    expected = LabelSettings(False, (1, 5), reward="only", reward_config=RewardConfig(form="exp"), threads=2)
    assert parsed.settings == expected


def test_labels_a_data_set(tiny_square, tmp_path, capsys):
    write_random_planner(tmp_path / "p.safetensors", observe="full", visual=None, mask_rgb=None)
    arguments = ["label", str(tiny_square("1.4.1", images=True)), str(tmp_path / "o.hdf5")]
    arguments += ["--planner", str(tmp_path / "p.safetensors"), "--limit", "1"]
    assert main([*arguments, "--reward", "augment", "--horizon-step", "1", "3"]) == 0
    assert "1 demonstration with hints and rewards" in " ".join(capsys.readouterr().err.split())
    with Demonstrations(tmp_path / "o.hdf5") as demos:
        assert demos[0].observation("ocp_hint").shape == (90, 13)
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err


def test_missing_images_are_one_line_with_the_remedy(tiny_square, tmp_path, capsys):
    write_random_planner(tmp_path / "p.safetensors")
    arguments = ["label", str(tiny_square()), str(tmp_path / "o.hdf5"), "--planner", str(tmp_path / "p.safetensors")]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert "error: " in error
    assert "Traceback" not in error
    assert "`ocplanner render SOURCE TARGET --observe masked --cameras agentview --size 84 --visual fast`" in error
