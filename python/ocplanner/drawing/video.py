"""Videos of episodes (mp4: H.264, 4:2:0, playable from the first byte) with the plan drawn in, and their frames."""

import contextlib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np

from ocplanner.drawing.overlay import Caption, draw_caption, draw_paths, enlarge
from ocplanner.errors import InvalidValueError, OutputError, ResultFileError, ShapeError
from ocplanner.files.storage import atomic_write, check_output

# The index comes first, and the same frames give the same bytes.
_PARAMETERS = "-preset fast -crf 21 -threads 1 -movflags +faststart -fflags +bitexact -f mp4"
_CODING: dict[str, Any] = {
    "codec": "libx264",
    "quality": None,
    "macro_block_size": 2,
    "ffmpeg_log_level": "error",
    "output_params": _PARAMETERS.split(),
}


def write_episode_video(
    path: str | Path,
    frames: Sequence[np.ndarray],
    planned_pixels: Sequence[np.ndarray | None] | None = None,
    achieved_pixels: np.ndarray | None = None,
    fps: float = 20,
    captions: Sequence[Caption] | None = None,
    *,
    shortest_side: int = 320,
    hold_seconds: float = 1.0,
) -> Path:
    """Write an episode with the current plan as red dots, the object's path as a cyan trail and a caption bar below.

    Args:
        path: the mp4; it appears whole or not at all.
        frames: T images (h, w, 3) uint8, upright, of one size; small ones are enlarged to ``shortest_side``.
        planned_pixels: for each frame the plan's (H, 2) pixels, or None while there is no plan.
        achieved_pixels: (T, 2) pixels of the object in each frame; NaN where unknown.
        fps: frames per second; the simulator's control rate plays in real time.
        captions: one for each frame.
        shortest_side: pixels.
        hold_seconds: how long the last frame stays, so that viewers can read the outcome.

    Raises:
        ShapeError: a list has another length than ``frames``, or an array has a wrong shape.
        OutputError: ffmpeg could not write the file.
    """
    count = len(frames)
    for name, values in (
        ("planned_pixels", planned_pixels),
        ("achieved_pixels", achieved_pixels),
        ("captions", captions),
    ):
        if values is not None and len(values) != count:
            raise ShapeError(f"{name}: expected one entry for each of {count} frames, found {len(values)}")

    def drawn() -> Iterable[np.ndarray]:
        for i, frame in enumerate(frames):
            image, factor = enlarge(np.asarray(frame), shortest_side)
            plan = None if planned_pixels is None else planned_pixels[i]
            trail = None if achieved_pixels is None else np.asarray(achieved_pixels)[: i + 1]
            image = draw_paths(image, _scaled(plan, factor), _scaled(trail, factor))
            yield image if captions is None else draw_caption(image, captions[i])

    return write_video(path, drawn(), fps=fps, hold_seconds=hold_seconds)


def _scaled(pixels: np.ndarray | None, factor: float) -> np.ndarray | None:
    return None if pixels is None else np.asarray(pixels, dtype=np.float64) * factor


def write_video(path: str | Path, frames: Iterable[np.ndarray], *, fps: float = 20, hold_seconds: float = 0.0) -> Path:
    """Encode frames (h, w, 3) uint8 with even sides as mp4, and hold the last one; the file is whole or absent.

    Raises:
        ShapeError: there are no frames, or a frame has another shape than the first.
        InvalidValueError: ``fps`` is not positive.
        OutputError: ffmpeg could not write the file; it prints the reason to standard error.
    """
    if not fps > 0:
        raise InvalidValueError(f"fps must be positive, found {fps}")
    path = Path(path)
    iterator = iter(frames)
    first = next(iterator, None)
    if first is None:
        raise ShapeError("a video needs at least one frame")
    height, width = first.shape[:2]
    if height % 2 or width % 2:
        raise ShapeError(f"frames of a video need even sides, found {height}x{width}")
    check_output(path, True, "mp4 video")
    with atomic_write(path) as partial:
        encoder = imageio_ffmpeg.write_frames(partial, (width, height), **{**_CODING, "fps": fps})
        count = 0
        with contextlib.closing(encoder):
            encoder.send(None)
            for frame in _held(first, iterator, round(hold_seconds * fps)):
                data = _bytes(frame, first.shape)
                count += 1
                try:
                    encoder.send(data)
                except OSError:  # ffmpeg has ended; the count below reports it
                    break
        if _count(partial) != count:  # imageio-ffmpeg does not look at the exit status
            raise OutputError(
                f"cannot write {path}: ffmpeg failed and printed why; check the folder and run the same command again"
            )
    return path


def _held(first: np.ndarray, rest: Iterable[np.ndarray], repeats: int) -> Iterator[np.ndarray]:
    """All frames, then the last one ``repeats`` more times."""
    frame = first
    for frame in itertools.chain([first], rest):
        yield frame
    yield from itertools.repeat(frame, repeats)


def _bytes(frame: np.ndarray, shape: tuple[int, ...]) -> bytes:
    if frame.shape != shape or frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        raise ShapeError(f"frame: expected {shape} uint8 as the first, found {frame.shape} {frame.dtype}")
    return np.ascontiguousarray(frame).tobytes()


def _count(path: Path) -> int:
    """The number of frames that can be decoded."""
    try:
        return imageio_ffmpeg.count_frames_and_secs(path)[0] or 0
    except RuntimeError:
        return 0


def read_video(path: str | Path) -> np.ndarray:
    """All frames of a video, (T, h, w, 3) uint8, read-only.

    Raises:
        ResultFileError: the video is missing or cannot be decoded.
    """
    path = Path(path)
    if not path.is_file():
        raise ResultFileError(f"no video at {path}")
    decoder: Iterator[Any] = imageio_ffmpeg.read_frames(path)
    try:
        width, height = next(decoder)["size"]
        frames = b"".join(decoder)
    except (OSError, RuntimeError, KeyError) as error:
        raise ResultFileError(f"cannot decode {path}: {str(error).splitlines()[-1]}") from error
    if not frames:
        raise ResultFileError(f"cannot decode {path}: it holds no frames")
    return np.frombuffer(frames, dtype=np.uint8).reshape(-1, height, width, 3)
