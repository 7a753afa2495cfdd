"""A view that stands still: a page that a notebook shows in a frame, and that can be saved."""

from __future__ import annotations

import html
import os
from pathlib import Path

from kickdrift.disk.kinds import PAGE
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.view.page import page
from kickdrift.view.scene import Scene

HEIGHT = 480  # pixels
FRAME = (
    '<iframe srcdoc="{page}" sandbox="allow-scripts allow-downloads" title="{title}" '
    'style="width: 100%; height: {height}px; border: 0"></iframe>'
)


class View:
    """A view of one moment, or of a run's frames. A notebook shows it; ``save`` writes it as a page.

    Attributes
    ----------
    scene : what the view shows, as plain texts, numbers and lists
    height : in a notebook, in pixels
    """

    def __init__(self, scene: Scene, height: int = HEIGHT) -> None:
        self.scene, self.height = scene, height

    def __repr__(self) -> str:
        frames = sum(chunk["count"] for chunk in self.scene["chunks"])
        return f"<View of {self.scene['title']}: frames {frames}; save('view.html') writes the page>"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, which can reach nothing outside."""
        title = html.escape(self.scene["title"])
        return FRAME.format(page=html.escape(page(self.scene)), title=title, height=self.height)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
        """Write the view as one page that needs no network. Return the page's path.

        Raises InputError for an existing file without ``overwrite``, and for a name that does not end in .html."""
        target = checked_target(path, PAGE, overwrite, [])
        with written_whole(target, PAGE, overwrite=overwrite) as part:
            part.write_text(page(self.scene), encoding="utf-8")
        return target
