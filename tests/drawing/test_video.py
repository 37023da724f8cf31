import subprocess

import imageio_ffmpeg
import numpy as np
import pytest

from ocplanner.drawing.overlay import Caption, caption_height
from ocplanner.drawing.video import read_video, write_episode_video, write_video
from ocplanner.errors import InvalidValueError, OutputError, ResultFileError, ShapeError


def test_an_episode_decodes_to_what_was_drawn(tmp_path, frames):
    count = len(frames)
    planned = [None] * 4 + [np.array([[80.0, 50.0]])] * (count - 4)
    achieved = np.stack([4.0 * np.arange(count) + 4, np.full(count, 10.0)], axis=1)
    captions = [Caption("Sawyer", "seed 10000", f"follow · step {i}") for i in range(count)]
    path = write_episode_video(tmp_path / "a" / "b.mp4", frames, planned, achieved, fps=20, captions=captions)
    video = read_video(path)
    assert video.shape == (count + 20, 320 + caption_height(480), 480, 3)
    y, x = 250, 400
    assert video[2, y, x].min() > 200
    assert video[6, y, x, 0] > 180
    assert video[6, y, x, 1] < 120
    assert [file.name for file in path.parent.iterdir()] == ["b.mp4"]


def test_the_file_plays_in_browsers_and_from_the_first_byte(tmp_path, frames):
    path = write_video(tmp_path / "v.mp4", frames)
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    said = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path)], capture_output=True, text=True).stderr
    assert "h264" in said
    assert "yuv420p" in said
    assert "20 fps" in said


def test_the_same_frames_give_the_same_file(tmp_path, frames):
    assert write_video(tmp_path / "a.mp4", frames).read_bytes() == write_video(tmp_path / "b.mp4", frames).read_bytes()


@pytest.mark.parametrize("argument", ["planned_pixels", "achieved_pixels", "captions"])
def test_lists_of_another_length_are_refused(tmp_path, frames, argument):
    with pytest.raises(ShapeError, match=argument):
        write_episode_video(tmp_path / "v.mp4", frames, **{argument: [None]})


def test_frames_that_do_not_fit_are_refused_and_leave_no_file(tmp_path, frames):
    for wrong in ([], [frames[0][:63]], [frames[0], frames[0][:62]]):
        with pytest.raises(ShapeError):
            write_video(tmp_path / "v.mp4", wrong)
    with pytest.raises(InvalidValueError):
        write_video(tmp_path / "v.mp4", frames, fps=0)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_the_way_is_an_error(tmp_path, frames):
    (tmp_path / "v.mp4").mkdir()
    with pytest.raises(OutputError):
        write_video(tmp_path / "v.mp4", frames)


@pytest.mark.parametrize("reads", ["cat > /dev/null", "head -c 1 > /dev/null"])
def test_a_failing_encoder_is_an_error_with_its_words(tmp_path, frames, monkeypatch, capfd, reads):
    encoder = tmp_path / "ffmpeg"
    encoder.write_text(f"#!/bin/sh\n{reads}\necho no such codec >&2\nexit 1\n")
    encoder.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(encoder))
    with pytest.raises(OutputError, match=r"cannot write .*v\.mp4"):
        write_video(tmp_path / "videos" / "v.mp4", frames)
    assert "no such codec" in capfd.readouterr().err
    assert list((tmp_path / "videos").iterdir()) == []


def test_what_is_no_video_is_an_error(tmp_path):
    with pytest.raises(ResultFileError, match="no video"):
        read_video(tmp_path / "absent.mp4")
    (tmp_path / "v.mp4").write_bytes(b"nothing")
    with pytest.raises(ResultFileError, match=r"cannot decode .*v\.mp4: [^\n]*Invalid data"):
        read_video(tmp_path / "v.mp4")
