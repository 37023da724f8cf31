import io

from rich.console import Console
from rich.progress import Progress

from ocplanner import progress
from ocplanner.progress import counting_columns, demonstrations_bar


def test_a_bar_says_what_it_counts_and_the_time():
    console = Console(file=io.StringIO(), force_terminal=True, width=140)
    with Progress(*counting_columns("pictures, {task.fields[rate]} a second"), console=console) as bar:
        bar.update(bar.add_task("drawing", total=4, rate=7), advance=1)
    said = console.file.getvalue()
    for text in ("drawing", "1/4", "pictures, 7 a second", "elapsed", "left"):
        assert text in said


def test_without_a_terminal_a_line_now_and_then_says_how_far_it_is(monkeypatch):
    monkeypatch.setattr(progress, "QUIET_SECONDS", 0.0)
    console = Console(file=io.StringIO(), width=140)
    with demonstrations_bar("rendering", 3, console) as advance:
        advance("demo_0", 100)
        advance("demo_1", 100)
    said = console.file.getvalue()
    assert "rendering: 1 of 3 demonstrations" in said
    assert "rendering: 2 of 3 demonstrations" in said


def test_nothing_is_said_too_often():
    console = Console(file=io.StringIO(), width=140)
    progress.PlainLines(console).say("just begun")
    assert console.file.getvalue() == ""
