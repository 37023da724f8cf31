"""Where a file of demonstrations comes from: robomimic, robosuite's own recorder, or a robot that nobody described."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

from ocplanner.files.hdf5 import HDF5File

Kind = Literal["robomimic", "robosuite", "other"]

_NOT_DEMONSTRATIONS = "this is no file of demonstrations: give the path of one"
_RECORD_AGAIN = "record or download the data set again"


class Origin(NamedTuple):
    """What recorded a file.

    Attributes:
        kind: ``robomimic``: with ``env_args``. ``robosuite``: a raw recording of ``collect_human_demonstrations``.
            ``other``: nothing says which task and robot.
        env_args: as robomimic has them, made from ``env_info`` for a raw recording; empty for ``other``.
    """

    kind: Kind
    env_args: dict[str, Any]


def origin_of(file: HDF5File) -> Origin:
    """Read the attributes of ``data``.

    Raises:
        DatasetError: the file holds no demonstrations, or the attributes are damaged.
    """
    if not file.has("data"):
        held = ", ".join(file.names("/")[:5]) or "nothing"
        raise file.error("data", f"no such group (the file holds: {held})", _NOT_DEMONSTRATIONS)
    attributes = file.attributes("data")
    if "env_args" in attributes:
        env_args = _object(file, "env_args", attributes["env_args"])
        if not isinstance(env_args.get("env_name"), str):
            raise file.error("env_args of data", "no object with an env_name", _RECORD_AGAIN)
        return Origin("robomimic", env_args)
    if "env" in attributes and "env_info" in attributes:
        return Origin("robosuite", _from_info(file, attributes))
    names = file.names("data")
    if not any(file.has(f"data/{name}/actions") for name in names[:1]):
        raise file.error("data", "no attribute env_args, and no demonstration with actions", _NOT_DEMONSTRATIONS)
    return Origin("other", {})


def _from_info(file: HDF5File, attributes: Mapping[str, Any]) -> dict[str, Any]:
    info = _object(file, "env_info", attributes["env_info"])
    name, version = str(info.pop("env_name", attributes["env"])), attributes.get("repository_version")
    robots = info.get("robots")
    return {
        "env_name": name,
        "env_version": None if version is None else str(version),
        "type": 1,
        "env_kwargs": {**info, "robots": [robots] if isinstance(robots, str) else robots},
    }


def _object(file: HDF5File, name: str, text: Any) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (TypeError, ValueError) as error:
        raise file.error(f"{name} of data", f"not JSON ({error})", _RECORD_AGAIN) from error
    if not isinstance(found, dict):
        raise file.error(f"{name} of data", f"no object ({type(found).__name__})", _RECORD_AGAIN)
    return found


def controllers(value: Any) -> Iterator[Mapping[str, Any]]:
    """Every arm's controller in robosuite's ``controller_configs``, whose nesting differs between versions."""
    if isinstance(value, list):
        for part in value:
            yield from controllers(part)
    elif isinstance(value, dict):
        if str(value.get("type", "")).startswith(("OSC", "JOINT", "IK")):
            yield value
            return
        for part in value.values():
            yield from controllers(part)


def is_absolute(controller: Mapping[str, Any]) -> bool:
    """Whether a controller's actions are targets rather than deltas."""
    return controller.get("input_type", "delta") != "delta" or controller.get("control_delta", True) is not True
