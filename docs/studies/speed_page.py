"""Write the tables, the figure and the numbers of docs/speed.md, measured by all usual groups of speed.py.

    python -m docs.studies.speed_page [--from FILE.json] [--only GROUP …] [--turns 15]

The numbers go to data/speed.json of this package. With --from the script reads them from a file and measures nothing.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from kickdrift.disk.outputs import write_json
from kickdrift.plots.drawing import COLOURS, INK, new_axes, new_figure, save_figure
from kickdrift_validation.docs_tables import put
from kickdrift_validation.docs_tables import table as markdown
from kickdrift_validation.folders import DATA, checkout
from kickdrift_validation.performance.speed import chosen, goals_table, left_out, measure, print_found, table

BEGIN, END = "<!-- what speed_page.py writes: from here -->", "<!-- to here -->"


def text_of(found: dict[str, Any]) -> str:
    """Text of the page: the machine, the claims, and a table for each group."""
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
    """Draw the ratios of speeds, with the errors of the energy."""
    groups = [group for group in found["groups"] if len(group.get("rows", ())) > 1]
    heights = [len(group["rows"]) + 0.4 for group in groups]
    half = next(k for k in range(1, len(groups) + 1) if 2 * sum(heights[:k]) >= sum(heights))
    tallest = max(sum(heights[:half]), sum(heights[half:]))
    figure = new_figure(12.0, 0.29 * tallest + 0.9)
    for k, part in enumerate((groups[:half], groups[half:])):
        if part:
            draw_groups(new_axes(figure, (1, 2, k + 1)), part, tallest)
    figure.suptitle("How many times as fast kickdrift is; in brackets, errors of the energy", fontsize=12, color=INK)
    return save_figure(figure, target)


def draw_groups(axes: Any, groups: list[dict[str, Any]], height: float) -> None:
    """Draw a line of text for each group, and a point for each program. A bar spans all rounds."""
    places, labels, heads, y = list[float](), list[str](), list[int](), 0.0
    for group in groups:
        ours, *others = group["rows"]
        axes.axhline(y, color=INK, linewidth=0.5)
        heads.append(len(places))
        places.append(y)
        labels.append(labelled(group["name"], ours))
        for k, row in enumerate(others, 1):
            ratio = row["ratio"]
            axes.plot([ratio["least"], ratio["most"]], [y + k, y + k], color=COLOURS[0], linewidth=1.5)
            axes.plot([ratio["median"]], [y + k], "o", color=COLOURS[0], markersize=4.5)
            axes.annotate(
                f"{ratio['median']:.3g}", (ratio["most"], y + k), (5, -2.5), textcoords="offset points", fontsize=7.5,
                color=INK,
            )  # fmt: skip
            places.append(y + k)
            labels.append(labelled(row["name"], row))
        y += len(group["rows"]) + 0.4
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xlim(0.5, 1000.0)
    axes.set_ylim(height - 0.6, -0.8)
    axes.set_yticks(places, labels, fontsize=8)
    for k in heads:
        axes.get_yticklabels()[k].set_fontweight("bold")
    axes.grid(False, axis="y")


def labelled(name: str, row: dict[str, Any]) -> str:
    """A name with the energy error in brackets, if there is an error."""
    return name if row["energy_error"] is None else f"{name} ({row['energy_error']:.0e})"


def main() -> int:
    """Measure or read the numbers, then write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE.json", help="measure nothing, read this")
    parser.add_argument("--only", action="append", default=[], metavar="GROUP", help="repeat for several")
    parser.add_argument("--turns", type=int, default=15, help="of each")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a turn")
    given = parser.parse_args()
    docs = checkout() / "docs"
    if given.source:
        found = json.loads(given.source.read_text(encoding="utf-8"))
    else:
        found = measure(chosen(given.only), given.turns, given.seconds)
        write_json(DATA / "speed.json", found, overwrite=True)
    print_found(found)
    put(docs / "speed.md", BEGIN, END, text_of(found))
    print(draw(found, docs / "speed.png"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
