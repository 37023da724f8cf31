"""Faults that come from outside: kill -9, a full disk, a read-only folder, a second process."""

import time
from collections.abc import Callable

import folders
from bench import Bench
from disk import SmallDisk
from process import VerbProcess
from rows import Row

_POLL_S = 0.0005
_OTHER_SETTINGS = 4096  # bytes: a file of settings and its temporary twin fit


def kill_at_random(bench: Bench, row: Row, tries: int) -> None:
    """Kill -9 at a moment drawn evenly from the time that the verb works, again and again until it is through."""

    def moment(running: VerbProcess) -> None:
        bench.await_work(running)
        until = time.monotonic() + bench.rng.uniform(0, bench.reference.span_s)
        while running.poll() is None and time.monotonic() < until:
            time.sleep(_POLL_S)

    _kill(bench, row, tries, moment)


def kill_while_writing(bench: Bench, row: Row, tries: int) -> None:
    """Kill -9 within two milliseconds of a file's appearing, being replaced or vanishing."""

    def moment(running: VerbProcess) -> None:
        left, seen = bench.rng.randint(1, bench.reference.appearances), bench.appeared()
        while running.poll() is None and left:
            now = bench.appeared()
            if now != seen:
                seen, left = now, left - 1
        time.sleep(bench.rng.uniform(0, 0.002))

    _kill(bench, row, tries, moment)


def _kill(bench: Bench, row: Row, tries: int, moment: Callable[[VerbProcess], None]) -> None:
    safe = 0.0
    assert bench.reference.span_s > 0
    bench.clear()
    while row.tries < tries:
        running = bench.start()
        moment(running)
        if running.kill():
            row.tries += 1
            safe = bench.check_whole(row, safe)
        else:
            row.tries += not bench.judge(running.wait(), row)  # a verb that always fails must not go on for ever
            bench.clear()
            safe = 0.0
    bench.finish(row)


def full_disk(bench: Bench, row: Row, tries: int) -> None:
    """Run on a disk with too little room, then again with room; without a disk of our own, limit the size of files."""
    need = 2 * bench.reference.size + _OTHER_SETTINGS
    try:
        disk = SmallDisk(bench.disk)
    except PermissionError:
        _limited_files(bench, row, tries)
        return
    try:
        for _ in range(tries):
            bench.clear()
            disk.leave_free(int(need * bench.rng.uniform(0, 0.8)))
            _disturbed(bench, row, bench.start(), disk.empty)
    finally:
        disk.close()


def _limited_files(bench: Bench, row: Row, tries: int) -> None:
    row.fault += " (files limited in size)"
    largest = max(path.stat().st_size for path in folders.files(bench.reference.folder).values())
    for _ in range(tries):
        bench.clear()
        _disturbed(bench, row, bench.start(largest_file=bench.rng.randrange(largest)), lambda: None)


def _disturbed(bench: Bench, row: Row, running: VerbProcess, mend: Callable[[], None]) -> None:
    """One try: the process must end with a clear error or with success, and succeed once the fault is mended."""
    row.tries += 1
    ending = running.wait()
    if ending.code == 0 or ending.clear:
        bench.check_whole(row, 0.0)
    else:
        row.wonder(ending.complaint)
    mend()
    if ending.code != 0:
        bench.finish(row)
    else:
        bench.judge(ending, row)


def read_only(bench: Bench, row: Row, tries: int) -> None:
    """Run in a folder that is read-only from the start, or since an earlier run was killed in it."""
    assert bench.reference.span_s > 0
    try:
        disk = SmallDisk(bench.disk)
    except PermissionError as refused:
        row.skipped = f"root ignores permissions, and no read-only disk can be mounted here ({refused})"
        return
    try:
        for number in range(tries):
            bench.clear()
            if number % 2:
                running = bench.start()
                bench.await_work(running)
                time.sleep(bench.rng.uniform(0, bench.reference.span_s))
                running.kill()
            before = {name: path.read_bytes() for name, path in folders.files(bench.work, hidden=True).items()}
            disk.read_only(True)
            row.tries += 1
            ending = bench.start().wait()
            if not ending.clear:
                row.wonder(ending.complaint)
            disk.read_only(False)
            after = {name: path.read_bytes() for name, path in folders.files(bench.work, hidden=True).items()}
            if before != after:
                row.lose("files changed in a read-only folder")
            bench.finish(row)
    finally:
        disk.close()


def two_processes(bench: Bench, row: Row, tries: int) -> None:
    """Start the same command while it runs: one is refused, the other one's result is the undisturbed one."""
    assert bench.reference.span_s > 0
    for _ in range(tries):
        bench.clear()
        first = bench.start()
        bench.await_work(first)
        time.sleep(bench.rng.uniform(0, bench.reference.span_s / 2))
        row.tries += 1
        second = bench.start(log="second log").wait()
        ending = first.wait()
        if not second.clear and not (second.code == 0 and ending.clear):
            row.wonder(f"the second process: {second.complaint}")
        bench.judge(ending if ending.code == 0 else second, row)
