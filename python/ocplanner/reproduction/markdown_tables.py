"""Rewriting the tables inside Markdown files, between ``<!-- NAME -->`` and ``<!-- end NAME -->``."""

from collections.abc import Mapping
from pathlib import Path

from ocplanner.errors import ResultFileError
from ocplanner.files.storage import atomic_write
from ocplanner.reproduction.paper_comparison import comparison_table
from ocplanner.reproduction.policy_tables import TABLES
from ocplanner.reproduction.summary import (
    encoder_table,
    failure_table,
    held_out_table,
    mask_error_table,
    matrix_table,
    policy_table,
    pose_noise_table,
    transfer_table,
)


def write_tables(results: Path) -> list[Path]:
    """Rewrite the tables in the results' ``README.md``, and, for the folder ``results``, in the project's pages.

    ``TABLE`` holds the success rates, ``MASKERROR`` those with wrong masks, ``HELDOUT`` the errors on held-out
    demonstrations, ``ENCODERS`` the errors of the encoders tried, ``TABLE1`` and ``TABLE2`` the success rates of
    policies, ``MATRIX`` every task on every arm, ``MATRIXFAILURES`` its failures, ``POSENOISE`` success with wrong
    poses, ``PAPER`` every rate that the paper states beside ours.

    Returns:
        The files that have such tables, changed or not.

    Raises:
        ResultFileError: a result file is damaged, or a table has no end marker.
        OutputError: a file cannot be written.
    """
    tables = {
        "TABLE": transfer_table(results / "transfer"),
        "MASKERROR": mask_error_table(results / "mask_error", results / "transfer"),
        "MATRIX": matrix_table(results / "matrix.json"),
        "MATRIXFAILURES": failure_table(results / "matrix.json"),
        "POSENOISE": pose_noise_table(results / "pose_noise"),
        "HELDOUT": held_out_table(results),
        "ENCODERS": encoder_table(results),
        "PAPER": comparison_table(results),
        **{f"TABLE{table.number}": policy_table(table, results) for table in TABLES.values()},
    }
    marked = []
    pages = [results / "README.md"]
    if results.resolve().name == "results":  # the main page shows no other set
        project = results.resolve().parent
        pages = [project / "README.md", *pages, project / "docs" / "paper.md"]
    for path in pages:
        if not path.is_file():
            continue
        before = path.read_text(encoding="utf-8")
        if not any(_start(name) in before for name in tables):
            continue
        after = replace_tables(before, tables, path)
        if after != before:
            with atomic_write(path) as temporary:
                temporary.write_text(after, encoding="utf-8")
        marked.append(path)
    return marked


def replace_tables(text: str, tables: Mapping[str, str], path: Path) -> str:
    """``text`` with the content between the markers of each table replaced; tables without markers are left out.

    Args:
        text: Markdown.
        tables: name of the markers -> the table.
        path: origin of the text, for messages.

    Raises:
        ResultFileError: a table begins but does not end.
    """
    for name, table in tables.items():
        start, end = _start(name), f"<!-- end {name} -->"
        before, found, rest = text.partition(start)
        if not found:
            continue
        _, ended, after = rest.partition(end)
        if not ended:
            raise ResultFileError(f"{path}: no {end} after {start}; add it where the table ends")
        text = f"{before}{start}\n{table}\n{end}{after}"
    return text


def _start(name: str) -> str:
    return f"<!-- {name} -->"
