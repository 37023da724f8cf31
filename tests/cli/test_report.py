import pytest

from ocplanner.cli import main
from random_policy import random_training, write_labelled, write_random_policy


def test_report_writes_the_page_and_says_where(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "metrics.jsonl").write_text('{"stage": "vae", "step": 1, "loss": 1.0, "valid_loss": 1.0}\n')
    assert main(["report", "run", "--out", "page.html", "--title", "A title"]) == 0
    assert capsys.readouterr().out.startswith("page.html (")
    assert "<h1>A title</h1>" in (tmp_path / "page.html").read_text()


def test_data_draws_what_policies_make_of_their_hints(tmp_path, tiny_square, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data = write_labelled(tiny_square(), tmp_path / "labelled.hdf5")
    write_random_policy(tmp_path / "hinted" / "policy.safetensors", data, random_training())
    assert main(["report", "hinted", "--data", str(tiny_square()), "--data", str(data)]) == 0
    assert list((tmp_path / "figures").iterdir()) == [tmp_path / "figures" / "hint_use_hinted.png"]
    assert "What they make of the hint" in (tmp_path / "report.html").read_text()
    assert main(["report", "hinted", "--data", str(tiny_square())]) == 2
    assert "no hints on record" in capsys.readouterr().err


def test_data_that_nothing_can_be_drawn_on_is_an_error(tmp_path, tiny_square, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_random_policy(tmp_path / "policy.safetensors", tiny_square(), random_training(hint=None))
    assert main(["report", "policy.safetensors", "--data", str(tiny_square())]) == 2
    assert "no policy with a hint" in capsys.readouterr().err
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize("arguments", [["absent"], ["."]])
def test_nothing_to_report_is_one_line_and_status_2(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.chdir(tmp_path)
    assert main(["report", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
