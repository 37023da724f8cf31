import json
from html.parser import HTMLParser

import pytest

from ocplanner.drawing.style import save_figure
from ocplanner.drawing.video import write_video
from ocplanner.errors import ResultFileError
from ocplanner.report.overlays import film_strip
from ocplanner.report.page import write_report

_VOID = {"meta", "link", "img", "br", "path", "use", "rect"}


class Page(HTMLParser):
    """Tags with their attributes, and the text; checks that tags are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags, self.text, self.open = [], "", []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if tag not in _VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.text += data

    def all(self, tag: str) -> list[dict]:
        return [attrs for name, attrs in self.tags if name == tag]


@pytest.fixture
def folder(tmp_path, frames, write_run, write_result):
    write_run("h5", horizon=5)
    write_run("h20", horizon=20)
    write_result("sawyer", successes=3, failures=("slip", "not aligned"))
    write_result("sawyer_1", successes=4, failures=("slip",), planner_sha256="cd" * 32)
    write_result("open", successes=0, failures=("slip",), follow="open-loop")
    for seed in (10000, 10004):
        write_video(tmp_path / "videos" / f"open_{seed}.mp4", frames)
    for kind in ("svg", "png"):
        save_figure(film_strip(list(frames)), tmp_path / "h20" / "figures" / f"segments.{kind}")
    return tmp_path


def report(path, **options) -> Page:
    return Page(write_report([path], path / "report.html", **options).read_text())


def test_the_page_shows_rates_failures_training_videos_and_figures(folder):
    page = report(folder)
    assert page.all("title") == [{}]
    for text in (
        "Square on Sawyer", "3/5", "4/5", "mean of 2 planners", "not aligned", "H = 5", "Configuration of h20",
        "ocplanner transfer --robot Sawyer", "mujoco", "3.9.0", "sawyer-base-contact", "abababababababab",
        "LSTM-VAE, validation loss", "rotation error, degrees", "finetune (kept)",
    ):  # fmt: skip
        assert text in page.text
    assert len(page.all("video")) == 2
    assert len(page.all("svg")) == 5
    assert [attrs["alt"][:10] for attrs in page.all("img") if attrs["alt"]] == ["The frames"]


def test_a_picture_that_lies_in_two_run_folders_is_shown_once(folder, frames):
    save_figure(film_strip(list(frames)), folder / "h5" / "figures" / "segments.png")
    assert len([attrs for attrs in report(folder).all("img") if attrs["alt"]]) == 1


def test_the_page_stands_alone_and_runs_nothing(folder):
    page = report(folder)
    for tag, attrs in page.tags:
        assert tag not in {"script", "iframe", "object", "embed", "form", "base"}
        assert not any(name.startswith("on") for name in attrs)
        for name in ("src", "href", "poster", "srcset", "data", "xlink:href"):
            assert attrs.get(name, "#").startswith(("data:", "#")), (tag, name)
    (policy,) = [attrs["content"] for attrs in page.all("meta") if attrs.get("http-equiv")]
    assert policy.startswith("default-src 'none'")
    text = (folder / "report.html").read_text()
    style = text[text.index("<style>") : text.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    assert "prefers-color-scheme: dark" in style


def test_identifiers_are_unique(folder):
    identifiers = [attrs["id"] for _, attrs in report(folder).tags if "id" in attrs]
    assert len(identifiers) == len(set(identifiers))


def test_names_from_files_are_text_not_markup(tmp_path, write_result, frames):
    hostile = "</style><script>alert(1)</script>"
    write_result(task=hostile, robot=hostile, failures=(hostile,), command=hostile, versions={hostile: hostile})
    write_video(tmp_path / "<img src=x>.mp4", frames)
    page = report(tmp_path, title=hostile)
    assert not page.all("script")
    assert hostile in page.text
    assert "<img src=x>.mp4" in page.text


def test_names_of_runs_are_text_in_charts(tmp_path, write_run):
    for name in ("<b>a</b>", "<b>b</b>"):
        folder = write_run("run")
        (folder).rename(tmp_path / name.replace("/", ""))
    page = report(tmp_path)
    assert len(page.all("b")) == 0


@pytest.mark.parametrize(
    ("most", "shown"), [(0, []), (1, ["good"]), (2, ["good", "bad"]), (3, ["good", "good", "bad"]), (9, None)]
)
def test_videos_beyond_the_limit_are_left_out_and_counted(tmp_path, frames, write_result, most, shown):
    write_result(successes=3, failures=("slip",))
    for i in range(4):
        write_video(tmp_path / f"{10000 + i}.mp4", frames[:2])
    page = report(tmp_path, most_videos=most)
    assert len(page.all("video")) == (4 if shown is None else most)
    assert (f"{most} of 4 videos" in page.text) == (0 < most < 4)
    if shown is not None:
        assert [attrs["class"] for attrs in page.all("b") if attrs.get("class") in ("good", "bad")][-most:] == shown


def test_training_alone_makes_a_page(write_run):
    page = report(write_run("run"))
    assert "Planner training" in page.text
    assert not page.all("video")


def test_policies_have_a_table_curves_and_pictures_of_their_hints(tmp_path, frames, write_policy_run, write_evaluation):
    write_policy_run("hinted", hint=(5,))
    write_policy_run("fresh", hint=(1,))
    for seed in (0, 1):
        write_evaluation(f"hint_{seed}", (2, 6), hint=(5,), seed=seed)
    save_figure(film_strip(list(frames)), tmp_path / "figures" / "hint_use_hinted.png")
    page = report(tmp_path)
    for text in (
        "Policies: Square on Panda", "k = 5 from the object", "0, 1", "60.0 ± 0.0", "40.0 ± 0.0", "25\N{EN DASH}55",
        "not evaluated", "Success while they learn", "held-out loss", "ocplanner evaluate --policy runs/bc", "3.7.0",
        "hint k = 1", "Configuration of hinted", "What they make of the hint",
    ):  # fmt: skip
        assert text in page.text
    assert page.text.count("not evaluated") == 1
    assert len(page.all("svg")) == 4
    assert [attrs["alt"][:13] for attrs in page.all("img")] == ["How a policy "]
    assert "Training the planner" not in page.text
    assert "Plans" not in page.text
    identifiers = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(identifiers) == len(set(identifiers))


def test_policies_stand_beside_transfers(folder, write_policy_run, write_evaluation):
    write_policy_run("policy")
    write_evaluation("evaluation")
    page = report(folder)
    for text in ("Square on Sawyer", "Training the planner", "Policies", "training loss", "LSTM-VAE"):
        assert text in page.text
    assert "Policies: " not in page.text


def test_names_in_evaluations_are_text_not_markup(tmp_path, write_evaluation):
    hostile = "</style><script>alert(1)</script>"
    path = write_evaluation("a")
    content = json.loads(path.read_text()) | {"task": hostile, "robot": hostile, "command": hostile}
    content["training"]["observation"]["cameras"] = [hostile]
    path.write_text(json.dumps(content))
    page = report(tmp_path)
    assert not page.all("script")
    assert hostile in page.text


def test_several_robots_are_compared_and_so_are_pose_errors(tmp_path, write_result):
    write_result("panda", robot="Panda", successes=3)
    write_result("sawyer")
    write_result("lift", task="Lift")
    write_result("can", task="Can")
    page = report(tmp_path)
    assert "Can, Lift and Square on Sawyer and Panda" in page.text
    assert "Every task on every robot" in page.text
    assert "Success against pose noise" not in page.text
    (tmp_path / "panda.json").unlink()
    write_result("noisy", pose_error={"position_mm": 5.0, "rotation_deg": 0.0, "latency_steps": 0})
    page = report(tmp_path)
    assert "Every task on every robot" not in page.text
    assert "Success against pose noise" in page.text
    assert "position noise, mm" in page.text


def test_results_without_failures_make_a_page(tmp_path, write_result):
    write_result(failures=())
    assert "2/2" in report(tmp_path).text


def test_a_damaged_video_is_an_error_that_names_it(tmp_path, write_result):
    write_result()
    (tmp_path / "10000.mp4").write_bytes(b"nothing")
    with pytest.raises(ResultFileError, match=r"10000\.mp4"):
        report(tmp_path)
    assert not (tmp_path / "report.html").exists()
