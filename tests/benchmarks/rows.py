"""Benchmark rows as a JSON file, as a Markdown table and as a bar chart."""

import json
from pathlib import Path
from typing import Any

from cases import Measured
from machine import machine_and_load
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

Row = dict[str, Any]

LEVELS = ("avx512", "avx2", "portable")
"""Instruction sets to which our engine can be restricted; the case name then ends in one."""

START, END = "<!-- BENCH -->", "<!-- end BENCH -->"
_SCALE = {"ms": 1e3, "us": 1e6}
_INK = "#848d97"
"""A grey that is readable on white and on dark pages; the figure is transparent."""
_COLORS = {
    "torch as trained": "#e69f00",
    "torch eager": "#d55e00",
    "torch.compile": "#cc79a7",
    "onnxruntime": "#3a9bdc",
    "openvino": "#009e73",
}


def row(case: str, unit: str, measured: Measured) -> Row:
    """One row: medians in ``unit``, and peer / ours as the ratio, above 1 where ours is faster."""
    scale = _SCALE[unit]
    medians = {name: timing.median for name, timing in measured.timings.items()}
    ours = medians.pop("ours")
    return {
        "case": case,
        "unit": unit,
        "ours": _rounded(ours * scale),
        "peers": {peer: _rounded(value * scale) for peer, value in medians.items()},
        "ratio": {peer: round(value / ours, 2) for peer, value in medians.items()},
        "quartiles": {
            name: [_rounded(value * scale) for value in timing.quartiles] for name, timing in measured.timings.items()
        },
        "rounds": measured.timings["ours"].rounds,
        "absent": measured.absent,
    }


def write(path: Path, rows: dict[str, Row], command: str, versions: dict[str, str]) -> list[Row]:
    """Write the rows beside the file's rows of other cases, and return all.

    Each row names the machine, the command and the versions it was measured with, because rows may date from different
    runs.
    """
    source = {"machine": machine_and_load(), "command": command, "versions": versions}
    rows = {case: {**measured, **source} for case, measured in rows.items()}
    earlier = json.loads(path.read_text())["rows"] if path.exists() else []
    merged = list(({known["case"]: known for known in earlier} | rows).values())
    result = {**source, "rows": merged}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(result, indent=1) + "\n")
    return merged


def table(rows: list[Row]) -> str:
    """A Markdown table: our time, and every peer's time with how many times longer it is."""
    peers = list(dict.fromkeys(peer for each in rows for peer in each["peers"]))
    lines = [f"| case | ocplanner | {' | '.join(peers)} |", "| --- |" + " ---: |" * (len(peers) + 1)]
    for each in rows:
        cells = [
            f"{each['peers'][peer]} ({each['ratio'][peer]}x)" if peer in each["peers"] else each["absent"].get(peer, "")
            for peer in peers
        ]
        lines.append(f"| {each['case']} | {each['ours']} {each['unit']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def insert(page: Path, text: str) -> None:
    """Replace the text between a page's markers. A page without markers stays as it is."""
    if not page.exists():
        return
    before, start, rest = page.read_text().partition(START)
    _, end, after = rest.partition(END)
    if start and end:
        page.write_text(f"{before}{START}\n{text}\n{END}{after}")


def chart(rows: list[Row], path: Path) -> None:
    """Draw the runtimes' times as multiples of ours, one group of bars per case at the best instruction set."""
    bars = [
        (each["case"], [(peer, each["ratio"][peer]) for peer in _COLORS if peer in each["ratio"]])
        for each in rows
        if not each["case"].endswith(LEVELS) and any(peer in each["ratio"] for peer in _COLORS)
    ]
    height = sum(len(group) + 1 for _, group in bars)
    figure = Figure(figsize=(8, 0.2 * height + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    at, labelled = 0.0, set()
    for case, group in bars:
        axes.text(0, at, case, color=_INK, fontsize=8, va="center", weight="bold")
        for peer, ratio in group:
            at += 1
            label = "_" if peer in labelled else peer
            labelled.add(peer)
            axes.barh(at, ratio, height=0.8, color=_COLORS[peer], label=label)
            axes.annotate(
                f"{ratio:.2f}x", (ratio, at), (3, 0), textcoords="offset points", va="center", fontsize=7, color=_INK
            )
        at += 1.4
    axes.axvline(1, color=_INK, linewidth=1, linestyle="--")
    axes.set_ylim(at - 0.5, -0.8)
    axes.set_yticks([])
    axes.set_xlabel(
        "time, in multiples of ocplanner's (dashed: the same time; longer is slower)", color=_INK, fontsize=8
    )
    axes.tick_params(colors=_INK, labelsize=8)
    for name, spine in axes.spines.items():
        spine.set_visible(name == "bottom")
        spine.set_color(_INK)
    figure.legend(fontsize=8, frameon=False, labelcolor=_INK, loc="outside upper left", ncols=len(_COLORS))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150, transparent=True)


def _rounded(value: float) -> float:
    """Three significant digits."""
    return float(f"{value:.3g}")
