"""How ``ocplanner convert`` wrote a data set: the attribute ``ocplanner_convert`` of its ``data``."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from ocplanner.settings import build, to_dict

CONVERT_ATTRIBUTE = "ocplanner_convert"


@dataclass(frozen=True)
class ConvertRecord:
    """What was converted, and what was changed on the way.

    Attributes:
        source: name of the file or folder that was read.
        next_obs: whether observations after each action were added.
        flip_gripper: whether the gripper's actions were multiplied by -1.
        flip_images: whether images were turned upside down.
        versions: installed packages.
    """

    source: str
    next_obs: bool = False
    flip_gripper: bool = False
    flip_images: bool = False
    versions: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_json(cls, text: str) -> "ConvertRecord":
        """Read the attribute.

        Raises:
            ValueError: it is no JSON, or a value in it is not what it should be; the message names it.
        """
        return build(cls, json.loads(text), ignore_unknown=True)

    def to_json(self) -> str:
        """Write the attribute."""
        return json.dumps(to_dict(self), sort_keys=True)
