"""What every notebook must keep to; `make test-notebooks` runs them."""

import ast
import json
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def cells(request) -> list[dict]:
    return json.loads(request.param.read_text())["cells"]


def code(cells: list[dict]) -> list[dict]:
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_there_are_notebooks():
    assert [path.stem[:2] for path in NOTEBOOKS] == ["01", "02", "03", "04", "05", "06"]


def test_no_outputs_are_committed(cells):
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code(cells))


def test_each_step_is_explained_first(cells):
    kinds = [cell["cell_type"] for cell in cells]
    assert kinds[0] == "markdown"
    assert kinds[-1] == "code"


def test_there_is_no_logic_of_their_own(cells):
    for cell in code(cells):
        nodes = [type(node) for node in ast.walk(ast.parse("".join(cell["source"])))]
        assert not {ast.FunctionDef, ast.ClassDef, ast.For, ast.While, ast.Lambda} & set(nodes)
