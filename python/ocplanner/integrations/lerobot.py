"""What runs beside LeRobot: a program that reads and writes LeRobot data sets for :mod:`ocplanner.demos.lerobot`.

lerobot and robosuite cannot be installed together: every lerobot that knows this format (0.4 and later) needs NumPy 2
(0.4 through rerun-sdk), and robosuite 1.5.2 needs mink 0.0.5, which needs NumPy below 2. So this file is run by the
Python of an environment that has lerobot, and imports nothing else of ocplanner. Requests come as lines of JSON on
standard input, answers go as lines of JSON to standard output, and arrays pass through ``.npz`` files.
"""

import importlib
import json
import os
import sys
from textwrap import shorten
from typing import Any, TextIO

import numpy as np

_PICTURES = ("image", "video")
_COLOURS = 3
_LONGEST = 200
_BOOKKEEPING = ("timestamp", "frame_index", "episode_index", "index", "task_index")


class _Side:
    """One data set, read or written; each public method is a request."""

    def __init__(self) -> None:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset  # pyright: ignore[reportMissingImports]

        self._kind: Any = LeRobotDataset
        self._data: Any = None

    def create(self, root: str, repo_id: str, fps: int, features: dict[str, Any], robot_type: str | None) -> None:
        """Begin a data set in a new folder."""
        features = {key: {**feature, "shape": tuple(feature["shape"])} for key, feature in features.items()}
        videos = any(feature["dtype"] == "video" for feature in features.values())
        self._data = self._kind.create(
            repo_id=repo_id, fps=fps, features=features, root=root, robot_type=robot_type, use_videos=videos
        )

    def add(self, arrays: str, task: str) -> None:
        """Append an episode, whose arrays are named as the features."""
        with np.load(arrays) as file:
            episode = {key: file[key] for key in file.files}
        for step in range(len(episode["action"])):
            self._data.add_frame({**{key: array[step] for key, array in episode.items()}, "task": task})
        self._data.save_episode()

    def finish(self) -> None:
        """Complete the files."""
        self._data.finalize()

    def open(self, root: str) -> dict[str, Any]:
        """Open a data set: its features, frequency, robot and the steps of each episode."""
        self._data = self._kind("local/read", root=root, video_backend=_video_backend())
        meta = self._data.meta
        features = {
            key: {"dtype": feature["dtype"], "shape": list(feature["shape"]), "names": feature.get("names")}
            for key, feature in meta.features.items()
            if key not in _BOOKKEEPING
        }
        steps = [end - start for start, end in map(self._span, range(meta.total_episodes))]
        return {"features": features, "fps": meta.fps, "robot_type": meta.robot_type, "steps": steps}

    def read(self, episode: int, arrays: str) -> dict[str, Any]:
        """Write an episode's arrays to a file; pictures as (T, h, w, 3) uint8. Its tasks are the answer."""
        start, end = self._span(episode)
        features = {key: feature for key, feature in self._data.meta.features.items() if key not in _BOOKKEEPING}
        numbers = [key for key, feature in features.items() if _is_number(feature["dtype"])]
        # As Arrow's own values: LeRobot's tensors would round float64 to float32.
        table = self._data.hf_dataset.with_format("arrow").select_columns(numbers)[start:end]
        found = {
            key: np.array(table[key].to_pylist(), features[key]["dtype"]).reshape(-1, *features[key]["shape"])
            for key in numbers
        }
        pictured = [key for key, feature in features.items() if _is_coloured(feature)]
        frames: dict[str, list[np.ndarray]] = {key: [] for key in pictured}
        tasks: dict[str, None] = {}
        for row in range(start, end):
            item = self._data[row]
            tasks[item["task"]] = None
            for key in pictured:
                frames[key].append(np.rint(np.asarray(item[key]) * 255).astype(np.uint8).transpose(1, 2, 0))
        np.savez(arrays, **found, **{key: np.stack(pictures) for key, pictures in frames.items()})
        return {"tasks": list(tasks)}

    def _span(self, episode: int) -> tuple[int, int]:
        row = self._data.meta.episodes[episode]
        return int(row["dataset_from_index"]), int(row["dataset_to_index"])


def _is_number(dtype: str) -> bool:
    try:
        return np.dtype(dtype).kind in "fiub"
    except TypeError:
        return False


def _is_coloured(feature: dict[str, Any]) -> bool:
    """Whether a feature is a picture in colour; depth has one channel."""
    return feature["dtype"] in _PICTURES and _COLOURS in (feature["shape"][0], feature["shape"][-1])


def _video_backend() -> str | None:
    """lerobot's default; PyAV where that would be a torchcodec that lacks the system's FFmpeg."""
    try:
        importlib.import_module("torchcodec")
    except (ImportError, OSError, RuntimeError):
        return "pyav"
    return None


def _serve(requests: TextIO, answers: TextIO) -> None:
    side: _Side | None = None
    for line in requests:
        request = json.loads(line)
        try:
            side = side or _Side()
            answer = getattr(side, request.pop("do"))(**request) or {}
        except Exception as error:  # lerobot and what it uses raise whatever they like; the caller reports it
            answer = {"error": shorten(f"{type(error).__name__}: {error}", _LONGEST, placeholder=" ...")}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    sys.path.pop(0)  # this file's folder, whose names hide lerobot and robomimic
    answering = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # encoders print
    _serve(sys.stdin, answering)
