"""Measure all usual groups of speed.py, and write docs/speed.md's tables, its figure and the numbers that they show.

    python validation/performance/speed_page.py [--from FILE.json] [--only GROUP …] [--turns 15] [--seconds 0.5]

The numbers go to validation/data/speed.json. With --from they are read from there, and nothing is measured.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from claim import CHECKOUT
from docs_tables import put
from docs_tables import table as markdown
from speed import chosen, goals_table, left_out, measure, print_found, table

from kickdrift.outputs import write_json
from kickdrift.plots import COLOURS, INK, new_axes, new_figure, save_figure

TOP = Path(__file__).parents[2]
DATA, PAGE, FIGURE = TOP / "validation" / "data" / "speed.json", TOP / "docs" / "speed.md", TOP / "docs" / "speed.png"
BEGIN, END = "<!-- what speed_page.py writes: from here -->", "<!-- to here -->"
GAP = 2  # rows between two groups of the figure


def text_of(found: dict[str, Any]) -> str:
    """Every group as a table, after what it ran on and what is claimed."""
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    parts = [
        f"{found['processor']}, {found['cores']} cores, {found['simd']}; {versions}; {found['turns']} turns of "
        f"{found['seconds']:g} s each; the load of the machine before was {found['load_before'] or 0:.1f}.",
        markdown(*goals_table(found)),
    ]
    for group in found["groups"]:
        if "times" in group or group["rows"]:
            parts += [f"### {group['name']}", f"{group['title']}.", markdown(*table(group))]
    if missing := left_out(found):
        parts.append("Left out: " + "; ".join(missing) + ".")
    return "\n\n".join(parts)


def draw(found: dict[str, Any], target: Path) -> Path:
    """How many times as fast kickdrift is as each, and how each errs."""
    groups = [group for group in found["groups"] if len(group.get("rows", ())) > 1]
    heights = [len(group["rows"]) - 1 + GAP for group in groups]
    half = next(k for k in range(1, len(groups) + 1) if 2 * sum(heights[:k]) >= sum(heights))
    columns = [list(zip(groups, heights, strict=True))[part] for part in (slice(half), slice(half, None))]
    total = max(sum(height for _, height in column) for column in columns)
    figure = new_figure(12.0, 0.36 * total + 0.6)
    for side, column in enumerate(columns):
        row = 0
        for group, height in column:
            axes = new_axes(figure, (total, 2, (2 * row + side + 1, 2 * (row + height - 1) + side + 1)))
            draw_group(axes, group)
            row += height
    figure.suptitle("How many times as fast kickdrift is", fontsize=12, color=INK)
    return save_figure(figure, target)


def draw_group(axes: Any, group: dict[str, Any]) -> None:
    """A point for each program; from the least to the most of the rounds."""
    ours, *others = group["rows"]
    for k, row in enumerate(reversed(others)):
        ratio = row["ratio"]
        axes.plot([ratio["least"], ratio["most"]], [k, k], color=COLOURS[0], linewidth=1.5)
        axes.plot([ratio["median"]], [k], "o", color=COLOURS[0], markersize=5)
        axes.annotate(
            f"{ratio['median']:.3g}", (ratio["median"], k), (0, 5), textcoords="offset points", fontsize=7, color=INK,
            ha="center",
        )  # fmt: skip
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xlim(0.5, max(20.0, 2 * max(row["ratio"]["most"] for row in others)))
    axes.set_ylim(-0.6, len(others) - 0.2)
    labels = [f"{row['name']} ({row['energy_error']:.0e})" for row in reversed(others)]
    axes.set_yticks(range(len(others)), labels, fontsize=8)
    axes.set_title(f"{group['name']} ({ours['energy_error']:.0e})", fontsize=9.5, color=INK, loc="left")
    axes.tick_params(axis="x", labelsize=7.5)


def main() -> int:
    """Measure or read, then write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE.json", help="measure nothing, read this")
    parser.add_argument("--only", action="append", default=[], metavar="GROUP", help="repeat for several")
    parser.add_argument("--turns", type=int, default=15, help="of each")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a turn")
    given = parser.parse_args()
    if not CHECKOUT:
        parser.error("the page is in a checkout, and this is none")
    if given.source:
        found = json.loads(given.source.read_text(encoding="utf-8"))
    else:
        found = measure(chosen(given.only), given.turns, given.seconds)
        write_json(DATA, found)
    print_found(found)
    put(PAGE, BEGIN, END, text_of(found))
    print(draw(found, FIGURE))
    return 0


if __name__ == "__main__":
    sys.exit(main())
