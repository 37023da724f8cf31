"""``demo.json``: what the files in a demo's folder are made from, so that other flags do not reuse them."""

import json
from dataclasses import dataclass
from pathlib import Path

from ocplanner.errors import OutputError
from ocplanner.files.storage import atomic_json
from ocplanner.settings import to_dict

NAME = "demo.json"


@dataclass(frozen=True)
class DemoInputs:
    """The flags of ``ocplanner demo`` that decide demonstrations, images and planner.

    Attributes:
        data: absolute path of the data set, or None if demonstrations are collected.
        data_bytes: size of that data set, bytes.
        demonstrations: how many are collected, or None.
        seed: seed of collecting and training.
        stages: training steps of each stage, or None for the preset's.
    """

    data: str | None
    data_bytes: int | None
    demonstrations: int | None
    seed: int
    stages: tuple[int, int, int] | None

    def claim(self, folder: Path) -> None:
        """Write ``demo.json`` into a new folder, or check that the one there says the same.

        Raises:
            OutputError: the folder holds files made from something else, or the file is damaged.
        """
        path = folder / NAME
        wanted = to_dict(self)
        if not path.exists():
            if folder.is_dir() and any(folder.iterdir()):
                raise OutputError(
                    f"{folder} is not empty and has no {NAME}; choose another --out, or delete the folder"
                )
            atomic_json(path, wanted)
            return
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            differing = [
                f"--{key.replace('_bytes', ' (bytes)')} {found[key]}, not {value}"
                for key, value in wanted.items()
                if found[key] != value
            ]
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise OutputError(f"{path} is damaged ({error}); choose another --out, or delete the folder") from error
        if differing:
            raise OutputError(
                f"{folder} was made with {'; '.join(differing)}; give the same flags, choose another --out, or delete "
                "the folder"
            )
