"""The pages' links lead somewhere, and the commands that they name exist with the flags that they use."""

import re
import shlex
from pathlib import Path

import pytest
import tyro

from ocplanner.cli import _commands

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(DOCS.glob("*.md"))
COMMANDS = sorted(
    {
        line.split("#")[0].strip()
        for page in PAGES
        for block in re.findall(r"^```sh\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL)
        for line in block.splitlines()
        if line.startswith("ocplanner ")
    }
)


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text()):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), target
        assert not anchor or anchor in anchors(linked), target


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_and_its_flags_exist(command):
    verb, *arguments = shlex.split(command)[1:]
    tyro.cli(_commands()[verb], args=arguments)  # exits where a flag, a choice or a file's place is wrong


def test_every_page_is_reached_from_the_index():
    index = (DOCS / "index.md").read_text()
    assert [page.name for page in PAGES if page.name != "index.md" and f"({page.name}" not in index] == []
