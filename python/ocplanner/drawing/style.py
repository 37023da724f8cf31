"""One look for every figure: colours, fonts, and how a figure becomes a file or part of a page.

Colours come from the Okabe-Ito palette, which people with any colour vision can tell apart. Over camera images, planned
paths are red dots and achieved paths cyan lines, so that their shapes differ as well as their hues.
"""

import io
import re
from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ocplanner.errors import UnknownNameError
from ocplanner.files.storage import atomic_write, check_output

PLANNED = "#ff2b2b"
ACHIEVED = "#00e5ff"
GOOD = "#3fcf8e"
BAD = "#ff965a"
INK = "#1f2328"
MUTED = "#667080"
GRID = "#d5dae1"
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b07d00", "#3a9bdc", "#5d4b9c", "#7a7a7a")
"""Line and bar colours in order of use."""

_PAGE_VARIABLES = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--grid",
    **{color: f"--series-{i}" for i, color in enumerate(SERIES)},
}
_FORMATS = ("svg", "png", "pdf")
_FONTS = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def page_colors() -> dict[str, str]:
    """CSS variable name -> colour, as :func:`page_svg` refers to them (light theme)."""
    return {variable: color for color, variable in _PAGE_VARIABLES.items()}


def styled() -> AbstractContextManager[None]:
    """A context in which matplotlib draws in this package's style, without touching the caller's settings."""
    return mpl.rc_context(
        {
            "font.family": "sans-serif",
            "font.sans-serif": ["DejaVu Sans"],
            "font.size": 9,
            "axes.titlesize": 9.5,
            "axes.titleweight": "bold",
            "axes.titlelocation": "left",
            "axes.labelsize": 9,
            "axes.labelcolor": INK,
            "axes.titlecolor": INK,
            "axes.edgecolor": MUTED,
            "axes.linewidth": 0.8,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.axisbelow": True,
            "grid.color": GRID,
            "grid.linewidth": 0.6,
            "text.color": INK,
            "xtick.color": MUTED,
            "ytick.color": MUTED,
            "xtick.labelcolor": INK,
            "ytick.labelcolor": INK,
            "xtick.labelsize": 8,
            "ytick.labelsize": 8,
            "legend.fontsize": 8,
            "legend.frameon": False,
            "lines.linewidth": 1.6,
            "figure.dpi": 110,
            "savefig.dpi": 160,
            "svg.fonttype": "none",
        }
    )


class _ShownFigure(Figure):
    """A figure that notebooks show although it is outside pyplot."""

    def _repr_png_(self) -> bytes:
        return _render(self, "png", salt="")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of ``width`` by ``height`` inches, laid out without overlaps, outside pyplot's global state."""
    figure = _ShownFigure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | Path, reads: Iterable[str | Path] = ()) -> Path:
    """Write ``figure`` to ``path`` (.svg, .png or .pdf), none of those it reads; it appears whole or not at all.

    Raises:
        UnknownNameError: the extension is none of these.
        OutputError: the file cannot be written, or is none that may be replaced.
    """
    path = Path(path)
    kind = path.suffix.lstrip(".").lower()
    if kind not in _FORMATS:
        raise UnknownNameError("figure format", kind, _FORMATS)
    check_output(path, True, "picture", reads)
    data = _render(figure, kind, salt=path.stem)
    with atomic_write(path) as partial:
        partial.write_bytes(data)
    return path


def page_svg(figure: Figure, name: str) -> str:
    """``figure`` as an ``<svg>`` element to stand inside a page and follow the page's colours.

    Ink, grid and series colours become CSS variables; identifiers begin with ``name``, unique in the page.
    """
    text = _render(figure, "svg", salt=name, transparent=True).decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', text)
    text = re.sub(r"'DejaVu Sans'(, sans-serif)?", _FONTS, text)
    for color, variable in _PAGE_VARIABLES.items():
        text = text.replace(color, f"var({variable})")
    return text


def _render(figure: Figure, kind: str, *, salt: str, transparent: bool = False) -> bytes:
    buffer = io.BytesIO()
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}[kind]
    with styled(), mpl.rc_context({"svg.hashsalt": salt}):
        figure.savefig(buffer, format=kind, metadata=metadata, transparent=transparent)
    return buffer.getvalue()
