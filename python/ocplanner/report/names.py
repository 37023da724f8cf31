"""Names for pictures of files, such that two files never share one."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path


def distinct_names(paths: Sequence[Path], names: Sequence[str] | None = None) -> list[str]:
    """One name a file: short where that is enough, with its folders in front where others have the same.

    ``a/sawyer/episode_10000.mp4`` is called ``episode_10000``; beside ``a/ur5e/episode_10000.mp4`` it becomes
    ``sawyer_episode_10000``.

    Args:
        paths: the files, no two the same.
        names: the short name of each; the file's name without its ending if not given.
    """
    shorts = [path.stem for path in paths] if names is None else list(names)
    folders = [path.resolve().parent.parts[1:] for path in paths]
    deepest = max(map(len, folders), default=0)
    chosen = list(shorts)
    for depth in range(1, deepest + 1):
        count = Counter(chosen)
        if max(count.values()) == 1:
            break
        chosen = [
            "_".join([*parts[-depth:], short]) if count[name] > 1 else name
            for name, parts, short in zip(chosen, folders, shorts)
        ]
    return chosen
