import pytest

from ocplanner.cli import main
from ocplanner.demos.dataset import Demonstrations


def test_converts_a_data_set(tiny_square, tmp_path, capsys):
    arguments = ["convert", str(tiny_square("1.4.1", images=True)), str(tmp_path / "o.hdf5"), "--limit", "2"]
    assert main([*arguments, "--next-obs", "--flip-gripper", "--flip-images"]) == 0
    assert "o.hdf5: 2 demonstrations" in " ".join(capsys.readouterr().err.split())
    with Demonstrations(tmp_path / "o.hdf5") as demos, Demonstrations(tiny_square()) as source:
        assert demos[0].next_observation_keys
        assert (demos[0].actions[:, 6] == -source[0].actions[:, 6]).all()
    assert main(arguments) == 2
    assert "exists already" in capsys.readouterr().err
    assert main([*arguments, "--overwrite"]) == 0


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--flip-images"], "holds no images to turn; leave out --flip-images"),
        (["--limit", "0"], "limit is 0, but must be at least 1"),
    ],
)
def test_what_cannot_be_done_is_one_line(tiny_square, tmp_path, capsys, flags, message):
    assert main(["convert", str(tiny_square()), str(tmp_path / "o.hdf5"), *flags]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("error: ")
    assert message in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--fps", "10", "--images", "png"], "only --to lerobot has --fps, --images"),
        (["--lerobot-python", "python"], "--lerobot-python is of no use from HDF5 to HDF5"),
        (["--to", "lerobot", "--next-obs"], "leave out --next-obs"),
        (["--to", "lerobot", "--lerobot-python", "/no/python"], "cannot run /no/python"),
    ],
)
def test_flags_that_cannot_take_effect_are_errors(tiny_square, tmp_path, capsys, flags, message):
    assert main(["convert", str(tiny_square()), str(tmp_path / "o"), *flags]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_a_lerobot_data_set_already_is_told(tmp_path, capsys):
    (tmp_path / "data/meta").mkdir(parents=True)
    (tmp_path / "data/meta/info.json").write_text("{}")
    assert main(["convert", str(tmp_path / "data"), str(tmp_path / "o"), "--to", "lerobot"]) == 2
    assert "is a folder, not an HDF5 file; leave out --to lerobot" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "data"), str(tmp_path / "o.hdf5")]) == 2
    assert "info.json cannot be read (KeyError('total_episodes'))" in capsys.readouterr().err
    assert main(["convert", str(tmp_path), str(tmp_path / "o.hdf5")]) == 2
    assert "no LeRobot data set (no meta/info.json); give the folder of one" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "none.hdf5"), str(tmp_path / "o.hdf5")]) == 2
    assert "no such file" in capsys.readouterr().err
