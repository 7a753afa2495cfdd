"""A matplotlib Figure that a notebook shows by itself."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A Figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        """The figure as a PNG file."""
        content = BytesIO()
        self.savefig(content, format="png")
        return content.getvalue()
