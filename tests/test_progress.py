import io

from rich.console import Console
from rich.progress import Progress

from ocplanner.progress import counting_columns


def test_a_bar_says_what_it_counts_and_the_time():
    console = Console(file=io.StringIO(), force_terminal=True, width=140)
    with Progress(*counting_columns("pictures, {task.fields[rate]} a second"), console=console) as bar:
        bar.update(bar.add_task("drawing", total=4, rate=7), advance=1)
    said = console.file.getvalue()
    for text in ("drawing", "1/4", "pictures, 7 a second", "elapsed", "left"):
        assert text in said
