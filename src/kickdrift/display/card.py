"""Cards for notebooks: a framed piece of HTML, with a sparkline where an object has a series of numbers."""

import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from kickdrift.text import CELL, clean

WIDTH, HEIGHT, EDGE = 240, 44, 3  # of a sparkline, in pixels
POINTS = 120  # columns of a sparkline: each shows the least and the greatest number of its part of the series
COLOUR = "#0072B2"
FRAME = "display: inline-block; border: 1px solid rgba(128, 128, 128, 0.4); border-radius: 6px; padding: 8px 12px"


class Spark(NamedTuple):
    """A series of numbers in the order of time, and a line of text about them."""

    values: Sequence[float]
    caption: str


def card(inside: str, spark: Spark | None) -> str:
    """HTML in a frame, with the sparkline above; ``inside`` is HTML already, the caption is escaped here."""
    return f'<div style="{FRAME}">{"" if spark is None else sparkline(spark)}\n{inside}\n</div>'


def sparkline(spark: Spark) -> str:
    """A series as an SVG picture with its caption below. Numbers that are not finite leave gaps, the zero is a line."""
    columns = _columns(spark.values)
    seen = [value for column in columns for value in column]
    low, high = min([0.0, *seen]), max([0.0, *seen])
    wide = max(len(columns) - 1, 1)
    scale = max(high / 2 - low / 2, math.ulp(0.0))  # halves: the range itself may overflow

    def place(k: int, value: float) -> str:
        x = EDGE + (WIDTH - 2 * EDGE) * k / wide
        return f"{x:.1f},{EDGE + (HEIGHT - 2 * EDGE) * (high / 2 - value / 2) / scale:.1f}"

    points = [place(k, value) for k, column in enumerate(columns) for value in column]
    line = f'<polyline points="{" ".join(points)}" fill="none" stroke="{COLOUR}" stroke-width="1.2"/>' if points else ""
    zero = place(0, 0.0).split(",")[1]
    axis = f'<line x1="0" x2="{WIDTH}" y1="{zero}" y2="{zero}" stroke="#888" stroke-width="0.5"/>'
    caption = escape(clean(spark.caption, CELL))
    picture = f'<svg width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="{caption}">{axis}{line}</svg>'
    return f'<div>{picture}<div style="font-size: 85%; opacity: 0.75">{caption}</div></div>'


def _columns(values: Sequence[float]) -> list[list[float]]:
    """The series in at most ``POINTS`` parts: least and greatest number of each, or the only one."""
    size = max(1, -(-len(values) // POINTS))
    found = []
    for k in range(0, len(values), size):
        part = [float(each) for each in values[k : k + size] if math.isfinite(each)]
        found.append([] if not part else sorted({min(part), max(part)}))
    return found
