"""What docs/paper.md says about the code must be there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text()
NAMED = re.findall(r"`([\w/]+\.(?:py|rs))` \(((?:`[\w.]+`(?:, )?)+)", PAGE)


@pytest.mark.parametrize(("file", "names"), NAMED, ids=[file for file, _ in NAMED])
def test_the_code_that_is_named_exists(file, names):
    path = ROOT / file if file.startswith("rust/") else ROOT / "python" / "ocplanner" / file
    text = path.read_text()
    for name in re.findall(r"`([\w.]+)`", names):
        assert re.search(rf"\b{name.split('.')[-1].split('::')[-1]}\b", text), f"{name} is not in {file}"


def test_the_pictures_are_there():
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", PAGE)
    assert pictures
    assert all((ROOT / "docs" / picture).exists() for picture in pictures)
