import pytest

from ocplanner.cli import main


def test_report_writes_the_page_and_says_where(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "metrics.jsonl").write_text('{"stage": "vae", "step": 1, "loss": 1.0, "valid_loss": 1.0}\n')
    assert main(["report", "run", "--out", "page.html", "--title", "A title"]) == 0
    assert capsys.readouterr().out.startswith("page.html (")
    assert "<h1>A title</h1>" in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize("arguments", [["absent"], ["."]])
def test_nothing_to_report_is_one_line_and_status_2(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.chdir(tmp_path)
    assert main(["report", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
