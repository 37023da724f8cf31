"""The conditions of a transfer: checked, named where they differ from the defaults, and read from result files."""

import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Annotated

import pytest
import tyro

from ocplanner.control.settings import ControlSettings, GraspSettings
from ocplanner.errors import InvalidValueError, UnknownNameError
from ocplanner.zero_shot.settings import TransferConfig


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"visual": "pretty"}, UnknownNameError, "known: fast, stock"),
        ({"control_loop": "fastest"}, UnknownNameError, "known: native, stock"),
        ({"mask_error": -2}, InvalidValueError, "-2 pixels"),
        ({"pose_noise": (-1.0, 0.0)}, InvalidValueError, "position is -1"),
        ({"pose_latency": -1}, InvalidValueError, "-1 steps"),
        ({"pose_filter": 0}, InvalidValueError, "at least 1"),
    ],
)
def test_values_outside_their_domain_are_errors(options, error, message):
    with pytest.raises(error, match=message):
        TransferConfig(**options)


def test_only_what_is_not_the_default_is_named():
    assert TransferConfig().names == TransferConfig().texts == ("gated",)
    off = TransferConfig(
        control=ControlSettings(follow="time", gain=2.0, grasp=GraspSettings(settle_steps=1)),
        visual="stock",
        allow_mismatch=True,
        patches=False,
        control_loop="stock",
        mask_error=2,
        pose_noise=(5.0, 2.5),
        pose_latency=3,
        pose_filter=8,
    )
    assert off.names == (
        *("time", "gain2.0", "settle-steps1", "stock", "unpatched", "stock-loop", "error2"),
        *("noise5mm2.5deg", "latency3", "filter8"),
    )
    assert off.texts == (
        *("time", "gain 2.0", "settle steps 1", "stock visuals", "no patches", "stock control loop", "mask 2 px off"),
        *("pose noise 5 mm 2.5°", "3-step pose latency", "averaged over 8 steps"),
    )


def test_a_new_option_needs_no_other_line_to_be_parsed_named_embedded_and_read_back():
    @dataclass(frozen=True)
    class Later(TransferConfig):
        wind: float = 0.0
        """Newtons."""

    parsed = tyro.cli(Annotated[Later, tyro.conf.arg(name="")], args=["--wind", "2.5", "--follow", "time"])
    assert parsed == replace(Later(), wind=2.5, control=ControlSettings(follow="time"))
    assert (parsed.names, parsed.texts) == (("time", "wind2.5"), ("time", "wind 2.5"))
    assert Later.from_result({"settings": parsed.to_json()}) == parsed
    assert Later.from_result({"settings": TransferConfig().to_json()}) == Later()  # of a file from before the option


def test_settings_are_read_as_they_were_written_and_unknown_ones_are_errors():
    settings = TransferConfig(control=ControlSettings(grasp=GraspSettings(tries=2)), pose_noise=(5.0, 2.0))
    assert TransferConfig.from_result({"settings": settings.to_json()}) == settings
    with pytest.raises(InvalidValueError, match="wind"):
        TransferConfig.from_result({"settings": {**settings.to_json(), "wind": 3}})


def test_patches_that_were_off_show_in_files_of_format_1_where_the_robot_has_some():
    old = {"follow": "gated", "patches": []}
    assert not TransferConfig.from_result({**old, "robot": "Sawyer"}).patches
    assert TransferConfig.from_result({**old, "robot": "Panda"}).patches
    assert TransferConfig.from_result({**old, "robot": "Sawyer", "patches": ["sawyer-base-contact"]}).patches


def test_they_are_cheap_to_import():
    heavy = ("mujoco", "robosuite", "torch", "ocplanner.zero_shot.episode")
    program = f"import sys, ocplanner.zero_shot.settings; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
