import io
import re

from rich.console import Console
from rich.progress import Progress

from ocplanner import progress
from ocplanner.progress import PlainLines, TrainingProgress, counting_columns, demonstrations_bar


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


def test_nothing_is_said_too_often(monkeypatch):
    console = Console(file=io.StringIO(), width=140)
    lines = PlainLines(console)
    lines.say_if_quiet(lambda: "just begun")
    assert console.file.getvalue() == ""
    monkeypatch.setattr(progress, "QUIET_SECONDS", 0.0)
    lines.say_if_quiet(lambda: "later")
    assert console.file.getvalue() == "later\n"


def test_a_training_without_a_terminal_says_its_step_loss_and_speed(monkeypatch, capsys):
    training = TrainingProgress()
    training.say("begun")
    with training.bar("vae", 10, 4) as advance:
        advance(0.5)
        monkeypatch.setattr(progress, "QUIET_SECONDS", 0.0)
        advance(0.25)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "begun"
    assert re.fullmatch(r"vae: step 6 of 10, loss 0\.25, [\d.]+ steps/s, \d+\.\d minutes left", second)


def test_only_the_first_of_several_processes_speaks(monkeypatch, capsys):
    monkeypatch.setattr(progress, "QUIET_SECONDS", 0.0)
    training = TrainingProgress(shown=False)
    training.say("begun")
    with training.bar("bc", 10, 0) as advance:
        advance(0.5)
    assert capsys.readouterr().err == ""


def test_a_training_on_a_terminal_shows_a_bar(monkeypatch):
    console = Console(file=io.StringIO(), force_terminal=True, width=140)
    monkeypatch.setattr(progress, "Console", lambda **_: console)
    with TrainingProgress().bar("vae", 10, 4) as advance:
        advance(0.5)
    said = console.file.getvalue()
    assert all(text in said for text in ("vae", "5/10", "loss 0.5"))
