"""What docs/paper.md says about the code must be there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text()
NAMED = re.findall(r"`([\w/]+\.(?:py|rs))` \(((?:`[\w.:]+`(?:, )?)+)", PAGE)
TABLE = PAGE.partition("## The equations, and the code")[2].partition("\n## ")[0]
EQUATIONS = [row.split("|") for row in TABLE.replace("\\|", "/").splitlines() if row.startswith("| ")][2:]


def source(file: str) -> str:
    return (ROOT / file if file.startswith("rust/") else ROOT / "python" / "ocplanner" / file).read_text()


@pytest.mark.parametrize(("file", "names"), NAMED, ids=[file for file, _ in NAMED])
def test_the_code_that_is_named_is_defined_there(file, names):
    text = source(file)
    for name in re.findall(r"`([\w.:]+)`", names):
        first, *others = re.split(r"\.|::", name)
        assert re.search(rf"\b(def|class|fn|struct|enum) {first}\b", text), f"{first} is not defined in {file}"
        assert all(re.search(rf"\b{other}\b", text) for other in others), f"{name} is not in {file}"


@pytest.mark.parametrize("row", EQUATIONS, ids=[row[1].strip()[:60] for row in EQUATIONS])
def test_each_equation_names_a_function(row):
    assert re.search(r"`[\w/]+\.(py|rs)` \(`", row[2]), row


def test_the_pictures_are_there():
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", PAGE)
    assert pictures
    assert all((ROOT / "docs" / picture).exists() for picture in pictures)
