"""The reference: it is built from all public modules, without warnings (pytest makes them errors) or a network."""

import importlib.util
import socket
from pathlib import Path

import pytest

import ocplanner.envs

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def reference():
    spec = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_public_module_is_listed(reference):
    names = set(reference.module_names())
    assert {"ocplanner", "ocplanner.planner.planner", "ocplanner.report.viewer.server", "ocplanner.cli.view"} <= names
    assert not {"ocplanner._core", "ocplanner.__main__", "ocplanner.integrations.robomimic"} & names


def test_it_is_built_without_a_network(reference, tmp_path, monkeypatch):
    def refuse(*_):
        raise AssertionError("a connection was tried")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    front = reference.build(tmp_path)
    assert "make_env" not in vars(ocplanner.envs)  # names that are imported on first use are so again
    text = front.read_text()
    for name in ("Planner", "Demonstrations", "plan_reward", "RewardConfig"):
        assert f'id="{name}"' in text
    assert "how many threads share a batch" in text  # of Planner.plan
    assert 'src="http' not in text
    pages = {str(page.relative_to(tmp_path)) for page in tmp_path.rglob("*.html")}
    assert {"index.html", "ocplanner/envs/environment.html", "ocplanner/policies/bcq.html"} <= pages
