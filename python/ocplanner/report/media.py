"""Episodes and pictures as data URIs, so that a page is one file."""

import base64
import io
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from ocplanner.drawing.video import read_video
from ocplanner.errors import ResultFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.report.overlays import evenly_spaced
from ocplanner.zero_shot.result import TransferResult

_TYPES = {".mp4": "video/mp4", ".png": "image/png", ".svg": "image/svg+xml"}


@dataclass(frozen=True)
class EmbeddedVideo:
    """An episode's mp4 in the page.

    Attributes:
        name: the file's name.
        uri: the mp4 as a data URI.
        poster: a frame from the middle as a data URI, shown before playing.
        strip: frames from first to last as data URIs (Figure 8).
        width: pixels.
        height: pixels.
        record: the result that it belongs to, if it was found.
        episode: the episode in that result.
    """

    name: str
    uri: str
    poster: str
    strip: tuple[str, ...]
    width: int
    height: int
    record: TransferResult | None
    episode: EpisodeResult | None


def embed_video(path: Path, records: Sequence[TransferResult], *, strip: int = 8) -> EmbeddedVideo:
    """Read, check and embed one mp4, and find the episode that it shows.

    Raises:
        ResultFileError: it is missing or cannot be decoded.
    """
    frames = read_video(path)
    record, episode = match_episode(path, records)
    return EmbeddedVideo(
        name=path.name,
        uri=embed_file(path),
        poster=embed_image(frames[len(frames) // 2]),
        strip=tuple(embed_image(frames[i]) for i in evenly_spaced(len(frames), strip)),
        width=frames.shape[2],
        height=frames.shape[1],
        record=record,
        episode=episode,
    )


def match_episode(path: Path, records: Sequence[TransferResult]) -> tuple[TransferResult | None, EpisodeResult | None]:
    """The episode that a video shows: its seed is a number in the file's name.

    The videos of a result ``a/b.json`` lie in ``a/b/``. A video elsewhere belongs to the nearest result, or, of several
    equally near, to the one whose robot and task stand in the path. If several still fit, it belongs to none.
    """
    seeds = [int(number) for number in re.findall(r"\d+", path.stem)]
    candidates = [
        ((_distance(path, record), *(name.lower() not in str(path).lower() for name in (record.robot, record.task))), i)
        for i, record in enumerate(records)
        if any(record.episode(seed) for seed in seeds)
    ]
    best = [i for rank, i in candidates if rank == min(candidates)[0]]
    if len(best) != 1:
        return None, None
    record = records[best[0]]
    return record, next(episode for seed in reversed(seeds) if (episode := record.episode(seed)))


def _distance(path: Path, record: TransferResult) -> int:
    """Folders between a video and a result; -1 if the video lies in the result's own folder."""
    result = record.path.resolve()
    if path.resolve().parent == result.with_suffix(""):
        return -1
    folders = path.resolve().parent, result.parent
    shared = len(Path(os.path.commonpath(folders)).parts)
    return sum(len(folder.parts) - shared for folder in folders)


def embed_file(path: Path) -> str:
    """A file as a data URI.

    Raises:
        ResultFileError: it cannot be read, or its kind is not known.
    """
    if path.suffix not in _TYPES:
        raise ResultFileError(f"cannot embed {path}: known kinds are {', '.join(_TYPES)}")
    try:
        return _uri(_TYPES[path.suffix], path.read_bytes())
    except OSError as error:
        raise ResultFileError(f"cannot read {path}: {error}") from error


def embed_image(image: np.ndarray, *, quality: int = 82) -> str:
    """An image (h, w, 3) uint8 as a JPEG data URI."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="jpeg", quality=quality, optimize=True)
    return _uri("image/jpeg", buffer.getvalue())


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
