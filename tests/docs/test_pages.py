"""The pages' links lead somewhere; the files, commands, flags and names that they give exist."""

import ast
import contextlib
import importlib
import inspect
import io
import re
import shlex
from functools import cache
from pathlib import Path

import pytest

import ocplanner
from ocplanner.cli import _commands, _parse
from ocplanner.policies.algorithms import ALGORITHMS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md"), *(ROOT / "results").glob("**/*.md")])
CHECKED = [page for page in PAGES if page.name != "CHANGELOG.md"]
"""Pages that speak of the present."""
TEXT = {page: page.read_text() for page in PAGES}
FOREIGN = {"--atheris", "--turn"}
"""Flags of other programs."""


def blocks(page: Path, *languages: str) -> list[str]:
    pattern = rf"^```(?:{'|'.join(languages)})\n(.*?)^```"
    return re.findall(pattern, TEXT[page], flags=re.MULTILINE | re.DOTALL)


def spans(page: Path) -> list[str]:
    """What stands between single backticks."""
    prose = re.sub(r"^```.*?^```", "", TEXT[page], flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"`([^`\n]+)`", prose)


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@cache
def flags(verb: str) -> set[str]:
    """Every flag of a verb, those of one algorithm included."""
    choices = [["--algorithm", name, "--hint"] for name in ALGORITHMS] if verb == "train-policy" else [[]]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for chosen in choices:
            with contextlib.suppress(SystemExit):
                _parse([verb, *chosen, "--help"])
    return set(re.findall(r"--[a-z][\w-]*", printed.getvalue()))


def of(*kinds) -> list:
    """Test parameters: (page, item) for each item that one of the functions finds in a page."""
    found = {(page, item) for page in CHECKED for kind in kinds for item in kind(page)}
    ordered = sorted(found, key=lambda pair: (str(pair[0]), pair[1]))
    return [pytest.param(page, item, id=f"{page.stem}: {item[:70]}") for page, item in ordered]


def commands(page: Path) -> list[str]:
    lines = [line.split("#")[0].strip() for block in blocks(page, "sh", "bash", "") for line in block.splitlines()]
    return [line for line in lines if line.startswith("ocplanner ")]


def mentioned_commands(page: Path) -> list[str]:
    return [span for span in spans(page) if re.match(r"ocplanner [a-z]", span)]


def mentioned_flags(page: Path) -> list[str]:
    return [span for span in spans(page) if re.match(r"--[a-z]", span)]


def files(page: Path) -> list[str]:
    """Paths from the root, and sources from the package's folder; ``CAPITALS`` and ``_N`` stand for something else."""
    named = [*spans(page), *re.findall(r"(?<=python )tests/\S+\.py", TEXT[page])]
    rooted, source = r"(python|rust|docs|results|tests|notebooks)/[\w./*-]+", r"\w+(/[\w*]+)+\.(py|rs)"
    paths = [name for name in named if re.fullmatch(rf"{rooted}|{source}", name)]
    return [path for path in paths if not re.search("[A-Z]{4}|_N[._]", path)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)]+)\)", TEXT[page]):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), target
        assert not anchor or anchor in anchors(linked), target


@pytest.mark.parametrize(("page", "command"), of(commands))
def test_a_command_and_its_flags_are_accepted(page, command):
    _parse(shlex.split(command)[1:])  # exits where a flag, a choice or a file's place is wrong


@pytest.mark.parametrize(("page", "command"), of(mentioned_commands))
def test_a_mentioned_command_and_its_flags_exist(page, command):
    verb, *words = command.split()[1:]
    assert verb in _commands()
    assert {word for word in words if word.startswith("--")} <= flags(verb)


@pytest.mark.parametrize(("page", "flag"), of(mentioned_flags))
def test_a_mentioned_flag_exists(page, flag):
    known = {known for verb in _commands() for known in flags(verb)}
    assert flag.split()[0] in known | FOREIGN


@pytest.mark.parametrize(("page", "name"), of(files))
def test_a_mentioned_file_exists(page, name):
    assert [*ROOT.glob(name), *(ROOT / "python" / "ocplanner").glob(name)], name


@pytest.mark.parametrize("page", CHECKED, ids=lambda page: page.stem)
def test_what_python_examples_import_exists(page):
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("ocplanner"):
                module = importlib.import_module(node.module)
                assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == []
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "ocp":
                assert hasattr(ocplanner, node.attr), node.attr


def calls(page: Path) -> list[str]:
    """Calls of ``ocp.NAME(...)`` in examples and in the text."""
    trees = [ast.parse(block) for block in blocks(page, "python")]
    trees += [ast.parse(span) for span in spans(page) if re.match(r"ocp\.\w+\(.*\)$", span)]
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [ast.unparse(node) for node in nodes if re.match(r"ocp\.\w+$", ast.unparse(node.func))]


@pytest.mark.parametrize(("page", "call"), of(calls))
def test_a_call_has_arguments_that_exist(page, call):
    node = ast.parse(call, mode="eval").body
    signature = inspect.signature(getattr(ocplanner, node.func.attr))
    signature.bind(*node.args, **{keyword.arg: None for keyword in node.keywords})


def test_every_page_is_reached_from_the_index():
    index = (DOCS / "index.md").read_text()
    assert [page.name for page in DOCS.glob("*.md") if page.name != "index.md" and f"({page.name}" not in index] == []
