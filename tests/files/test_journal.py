import pytest

from ocplanner.errors import OutputError
from ocplanner.files.journal import Journal
from ocplanner.files.records.episode import EpisodeResult

RUNS = [EpisodeResult(10000, True, 150, None, "follower"), EpisodeResult(10001, False, 400, "time-out", None)]


def test_what_was_added_is_there_again(tmp_path):
    path = tmp_path / "result.json.journal"
    journal = Journal(path, {"robot": "Sawyer"})
    for run in RUNS:
        journal.add(run)
    assert Journal(path, {"robot": "Sawyer"}).runs == {run.seed: run for run in RUNS}


def test_an_episode_run_again_for_its_film_stands_once(tmp_path):
    path = tmp_path / "result.json.journal"
    journal = Journal(path, {})
    for run in RUNS:
        journal.add(run)
    journal.add(RUNS[0], filmed=True)
    for read in (journal, Journal(path, {})):
        assert list(read.runs.values()) == RUNS
        assert read.filmed == {10000}


def test_lines_that_do_not_speak_of_films_are_read(tmp_path):
    path = tmp_path / "result.json.journal"
    line = '{"seed": 7, "success": true, "steps": 3, "failure": null, "released_by": "follower"}'
    path.write_text("{}\n" + line + "\n")
    assert list(Journal(path, {}).runs) == [7]
    assert Journal(path, {}).filmed == set()


def test_a_line_cut_by_a_kill_is_dropped_and_written_again(tmp_path):
    path = tmp_path / "result.json.journal"
    journal = Journal(path, {})
    for run in RUNS:
        journal.add(run)
    path.write_bytes(path.read_bytes()[:-9])
    journal = Journal(path, {})
    assert list(journal.runs) == [10000]
    journal.add(RUNS[1])
    assert list(Journal(path, {}).runs) == [10000, 10001]


def test_the_setting_that_differs_is_named(tmp_path):
    path = tmp_path / "result.json.journal"
    Journal(path, {"settings": {"pose_latency": 0, "mask_error": 0}})
    with pytest.raises(OutputError, match=r"another settings\.pose_latency;"):
        Journal(path, {"settings": {"pose_latency": 1, "mask_error": 0}})


def test_another_transfers_journal_is_refused(tmp_path):
    path = tmp_path / "result.json.journal"
    Journal(path, {"robot": "Sawyer", "follow": "gated"})
    with pytest.raises(OutputError, match="another robot"):
        Journal(path, {"robot": "UR5e", "follow": "gated"})


@pytest.mark.parametrize(
    "damage", [b"\xfc\x80\xff", b"{}\n{\xc2}\n", b"{}\nno JSON\n", b'{}\n{"seed": 7}\n', b"{}\n[]\n"]
)
def test_a_damaged_journal_is_named_and_left_alone(tmp_path, damage):
    path = tmp_path / "result.json.journal"
    path.write_bytes(damage)
    with pytest.raises(OutputError, match=r"result\.json\.journal is damaged .*delete it"):
        Journal(path, {})
    assert path.read_bytes() == damage
