import xml.etree.ElementTree as ElementTree

import pytest
from PIL import Image

from ocplanner.drawing.style import INK, SERIES, new_figure, page_colors, page_svg, save_figure, styled
from ocplanner.errors import UnknownNameError


@pytest.fixture
def figure():
    with styled():
        figure = new_figure(3, 2)
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], color=SERIES[0], label="<line>")
        axes.legend()
        axes.set_title("A & B")
    return figure


@pytest.mark.parametrize("kind", ["svg", "png", "pdf"])
def test_figures_are_saved_the_same_each_time(tmp_path, figure, kind):
    path = tmp_path / f"figure.{kind}"
    first = save_figure(figure, path).read_bytes()
    assert save_figure(figure, path).read_bytes() == first
    assert len(first) > 500


def test_a_png_has_the_size_asked_for(tmp_path, figure):
    with Image.open(save_figure(figure, tmp_path / "figure.png")) as image:
        assert image.size == (480, 320)


def test_notebooks_show_a_figure_without_pyplot(figure):
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_an_unknown_format_is_an_error(tmp_path, figure):
    with pytest.raises(UnknownNameError, match="svg"):
        save_figure(figure, tmp_path / "figure.gif")


def test_svg_in_a_page_follows_its_colours_and_keeps_to_its_names(figure):
    text = page_svg(figure, "loss")
    root = ElementTree.fromstring(text)  # noqa: S314 our own text
    assert "width" not in root.attrib
    assert "viewBox" in root.attrib
    assert "var(--series-0)" in text
    assert SERIES[0] not in text
    assert INK not in text
    identifiers = [element.attrib["id"] for element in root.iter() if "id" in element.attrib]
    assert identifiers
    assert all(identifier.startswith("loss-") for identifier in identifiers)
    for reference in text.split("url(#")[1:]:
        assert reference.split(")")[0] in identifiers
    assert "&lt;line&gt;" in text


def test_every_page_colour_has_one_variable():
    assert len(set(page_colors().values())) == len(page_colors())
