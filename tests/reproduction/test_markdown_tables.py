"""Tables inside Markdown files."""

from pathlib import Path

import pytest

from ocplanner.cli import main
from ocplanner.errors import ResultFileError
from ocplanner.reproduction.markdown_tables import replace_tables, write_tables
from transfer_results import transfer_result

ROOT = Path(__file__).parents[2]


@pytest.fixture
def results(tmp_path):
    transfer_result(9).save(tmp_path / "results" / "transfer" / "square.json")
    (tmp_path / "README.md").write_text("# A\n<!-- TABLE -->\nold\n<!-- end TABLE -->\nafter\n")
    return tmp_path / "results"


def test_only_what_stands_between_the_markers_is_replaced_and_once_is_enough(results, capsys):
    readme = results.parent / "README.md"
    assert main(["reproduce", "tables", "--results", str(results)]) == 0
    assert "README.md" in capsys.readouterr().out
    once = readme.read_text()
    table = "| follow | observe | Sawyer |\n| --- | --- | --- |\n| gated | masked | 9/10 |"
    assert once == f"# A\n<!-- TABLE -->\n{table}\n<!-- end TABLE -->\nafter\n"
    stamp = readme.stat().st_mtime_ns
    assert write_tables(results) == [readme]
    assert (readme.read_text(), readme.stat().st_mtime_ns) == (once, stamp)


def test_a_file_without_markers_is_left_alone(results):
    (results / "README.md").write_text("no table here\n")
    assert write_tables(results) == [results.parent / "README.md"]
    assert (results / "README.md").read_text() == "no table here\n"


def test_a_table_that_does_not_end_is_an_error():
    with pytest.raises(ResultFileError, match="no <!-- end TABLE -->"):
        replace_tables("<!-- TABLE -->\nold\n", {"TABLE": "new"}, Path("README.md"))


@pytest.mark.parametrize("name", ["results", "results/encoder_16-32-64-128"])
def test_the_committed_tables_are_those_of_the_committed_results(name, tmp_path):
    folder = tmp_path / name
    folder.mkdir(parents=True)
    read = ("transfer", "mask_error", "pose_noise", "heldout.json", "encoders.json", "table1.json", "table2.json")
    for entry in (*read, "matrix.json"):
        if (ROOT / name / entry).exists():
            (folder / entry).symlink_to(ROOT / name / entry)
    pages = ("README.md", f"{name}/README.md", "docs/paper.md")
    committed = {path: (ROOT / path).read_text() for path in pages}
    for path, text in committed.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text)
    write_tables(folder)
    assert {path: (tmp_path / path).read_text() for path in committed} == committed


def test_a_further_set_of_results_is_not_shown_on_the_main_page(results):
    page = results / "README.md"
    page.write_text("<!-- TABLE -->\n<!-- end TABLE -->\n")
    (results / "other" / "transfer").mkdir(parents=True)
    assert write_tables(results / "other") == []
    assert page.read_text() == "<!-- TABLE -->\n<!-- end TABLE -->\n"
