"""Episodes as mp4 (H.264, 4:2:0, playable from the first byte) with the plan drawn in, and back to frames."""

import subprocess
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from ocplanner.drawing.overlay import Caption, draw_caption, draw_paths, enlarge
from ocplanner.errors import InvalidValueError, OutputError, ResultFileError, ShapeError
from ocplanner.files.storage import atomic_write


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
    """Write an episode: the plan in force as red dots, the object's path so far as a cyan trail, a caption bar below.

    Args:
        path: the mp4; it appears whole or not at all.
        frames: T images (h, w, 3) uint8, upright, of one size. Small ones are enlarged to ``shortest_side``.
        planned_pixels: for each frame the plan's (H, 2) pixels, or None while there is no plan.
        achieved_pixels: (T, 2) pixels of the object in each frame; NaN where it is unknown.
        fps: frames a second; the simulator's control rate plays in real time.
        captions: one a frame.
        shortest_side: pixels.
        hold_seconds: how long the last frame stays, so that the outcome can be read.

    Raises:
        ShapeError: a list's length differs from the frames', or an array has another shape.
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
    """Encode frames (h, w, 3) uint8 with even sides as mp4; the file appears whole or not at all.

    Raises:
        ShapeError: there are no frames, or one has another shape than the first.
        InvalidValueError: ``fps`` is not positive.
        OutputError: ffmpeg could not write the file.
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
    with atomic_write(path) as partial, tempfile.TemporaryFile() as log:
        command = _encoder(width, height, fps, partial)
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log) as process:
            try:
                _feed(process, first, iterator, repeats=round(hold_seconds * fps))
            except BaseException:
                process.kill()
                raise
        if process.returncode:
            log.seek(0)
            reason = log.read().decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
            raise OutputError(f"cannot write {path}: ffmpeg says {reason[0]!r}")
    return path


def _feed(process: "subprocess.Popen[bytes]", first: np.ndarray, rest: Iterable[np.ndarray], *, repeats: int) -> None:
    if process.stdin is None:  # Popen was asked for a pipe
        return
    try:
        frame = first
        process.stdin.write(_bytes(first, first.shape))
        for frame in rest:
            process.stdin.write(_bytes(frame, first.shape))
        for _ in range(repeats):
            process.stdin.write(_bytes(frame, first.shape))
        process.stdin.close()
    except BrokenPipeError:
        process.wait()


def _bytes(frame: np.ndarray, shape: tuple[int, ...]) -> bytes:
    if frame.shape != shape or frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        raise ShapeError(f"frame: expected {shape} uint8 as the first, found {frame.shape} {frame.dtype}")
    return np.ascontiguousarray(frame).tobytes()


def _encoder(width: int, height: int, fps: float, path: Path) -> list[str]:
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-"]
    coding = ["-an", "-c:v", "libx264", "-preset", "fast", "-crf", "21", "-pix_fmt", "yuv420p", "-threads", "1"]
    target = ["-movflags", "+faststart", "-fflags", "+bitexact", "-f", "mp4", str(path)]
    quiet = ["-hide_banner", "-loglevel", "error", "-nostdin", "-y"]
    return [imageio_ffmpeg.get_ffmpeg_exe(), *quiet, *source, *coding, *target]


def read_video(path: str | Path) -> np.ndarray:
    """All frames of a video, (T, h, w, 3) uint8, read-only.

    Raises:
        ResultFileError: it is missing or cannot be decoded.
    """
    path = Path(path)
    if not path.is_file():
        raise ResultFileError(f"no video at {path}")
    source = ["-hide_banner", "-loglevel", "error", "-nostdin", "-i", str(path)]
    target = ["-f", "image2pipe", "-c:v", "ppm", "-"]
    done = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *source, *target], capture_output=True)
    if done.returncode or not done.stdout:
        reason = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["it holds no frames"]
        raise ResultFileError(f"cannot decode {path}: {reason[0]}")
    header = b"\n".join(done.stdout.split(b"\n", 3)[:3]) + b"\n"  # P6, width and height, 255: the same for each frame
    width, height = (int(side) for side in header.split()[1:3])
    images = np.frombuffer(done.stdout, dtype=np.uint8).reshape(-1, len(header) + height * width * 3)
    return images[:, len(header) :].reshape(-1, height, width, 3)
