"""The simulation's benchmark: its sides do the same work, and its figures are what they are called."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from camera_cases import two_cameras
from sim_measured import SimMeasured, table
from transfer_cases import _processor_seconds_a_step, _seconds_a_step, _Span
from turns import taking_turns


class Sleeper:
    """Counts what it is asked to do."""

    def __init__(self) -> None:
        self.prepared: list[int] = []

    def prepare(self, index: int) -> None:
        self.prepared.append(index)

    def act(self, index: int) -> tuple[int, list[int]]:
        return index, self.prepared.copy()


def test_sides_play_the_same_calls_and_the_first_turn_does_not_count() -> None:
    played = taking_turns({"ours": Sleeper, "theirs": Sleeper}, turns=2, calls=3)
    for turns in played.values():
        assert [turn.value[0] for turn in turns] == [0, 1, 2, 3, 4, 5]
        assert turns[-1].value[1] == [0, 1, 2, 0, 1, 2, 3, 4, 5]
        assert all(0 < turn.wall < 1 for turn in turns)


def test_two_cameras_are_faster_than_robosuites_and_move_alike() -> None:
    measured = two_cameras("Panda", 10)
    assert measured.seconds["robosuite"] > 3 * measured.seconds["ours"]


def test_a_rate_and_a_time_have_the_same_ratio() -> None:
    seconds = {"ours": 0.01, "robosuite": 0.08}
    rate = SimMeasured(seconds, "control steps/s", "wall clock").row("a")
    time = SimMeasured(seconds, "s an episode", "wall clock", {"steps": 3}).row("b")
    assert (rate["ours"], rate["peers"]) == (100, {"robosuite": 12.5})
    assert (time["ours"], time["peers"], time["steps"]) == (0.01, {"robosuite": 0.08}, 3)
    assert rate["ratio"] == time["ratio"] == {"robosuite": 8.0}
    assert "| a | 100.0 control steps/s | robosuite 12.5 (8.0x) |" in table([rate, time])


def test_workers_are_timed_from_the_second_episode_of_each_to_the_last_of_all() -> None:
    spans = [
        _Span(process=1, start=0.0, end=9.0, processor=9.0, steps=100),
        _Span(process=2, start=1.0, end=10.0, processor=9.0, steps=100),
        _Span(process=1, start=10.0, end=12.0, processor=1.0, steps=30),
        _Span(process=2, start=11.0, end=14.0, processor=2.0, steps=50),
    ]
    assert _seconds_a_step(spans) == pytest.approx((14 - 10) / 80)
    assert _processor_seconds_a_step(spans) == pytest.approx((1 + 2) / 80)
