"""Results of transfers that were never run, for what reads them."""

from typing import Any

from ocplanner.control.settings import ControlSettings
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.zero_shot.result import TransferResult, with_episodes
from ocplanner.zero_shot.settings import TransferConfig


def transfer_result(
    successes: int,
    episodes: int = 10,
    *,
    task: str = "Square",
    robot: str = "Sawyer",
    observe: str = "masked",
    planner_seed: int = 0,
    planner_sha256: str = "ab" * 32,
    failures: tuple[str, ...] = (),
    follow: str = "gated",
    **settings: Any,
) -> TransferResult:
    """A result whose first episodes succeeded; ``settings`` are conditions of the transfer.

    ``failures`` are the classes of the first failed episodes; the others slipped.
    """
    classes = [None] * successes + [*failures, *["slip"] * episodes][: episodes - successes]
    runs = [EpisodeResult(10000 + i, failure is None, 150, failure) for i, failure in enumerate(classes)]
    blank = TransferResult(
        task=task,
        robot=robot,
        observe=observe,
        visual="fast",
        planner_visual="fast",
        patches=(),
        settings=TransferConfig(control=ControlSettings(follow=follow), **settings),
        privileged=("object pose",),
        planners=("p.safetensors",),
        planner_sha256=planner_sha256,
        planner_seed=planner_seed,
        command="ocplanner transfer",
        versions={},
    )
    return with_episodes(blank, runs)
