"""One self-contained HTML page of a scene, which needs no network, and a view that stands still."""

import html
import json
import os
from importlib.resources import files
from pathlib import Path
from typing import Any

from kickdrift.disk.kinds import PAGE
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.display.showing import last_stage
from kickdrift.run.simulation import Simulation
from kickdrift.trajectory.read import reader
from kickdrift.view.scene import Scene, scene_of

# A page may run its own two scripts and styles, and may load nothing.
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
START = """\
const scene = JSON.parse(document.getElementById("scene").textContent);
globalThis.view = await globalThis.kickdriftView.mount(document.getElementById("view"), scene, {live: false});
globalThis.view.focus();
"""
PAGE_TEXT = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="kickdrift view">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
<style>html, body, #view {{ height: 100%; margin: 0; overflow: hidden }}</style>
</head>
<body>
<div id="view"></div>
<noscript>This page needs JavaScript to show the particles.</noscript>
<script type="application/json" id="scene">{scene}</script>
<script type="module">{bundle}</script>
<script type="module">{start}</script>
</body>
</html>
"""


def bundle() -> str:
    """Text of the viewer, an ES module with three.js inside; it exports ``mount``."""
    return (files("kickdrift.view") / "assets" / "viewer.js").read_text(encoding="utf-8")


def page(scene: Scene) -> str:
    """The page of a scene, as HTML text. Names and titles appear as text, whatever marks they hold."""
    return page_of(scene, START, POLICY)


def page_of(scene: Scene, start: str, policy: str) -> str:
    """The page of a scene that the script ``start`` shows, under a content security policy."""
    return PAGE_TEXT.format(
        policy=policy,
        title=html.escape(f"{scene['title']} · kickdrift"),
        scene=as_json(scene),
        bundle=bundle(),
        start=start,
    )


def as_json(value: Any) -> str:
    """JSON that may stand inside a script element: no text in it can end the element or begin a comment."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def write_page(
    given: reader.Run | Any | Simulation | str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    frames: int | None = None,
    colour: str | None = None,
    size: float = 1.0,
    overwrite: bool = False,
) -> Path:
    """Write the page of a run, a System, a Simulation or a file. Return the page's path.

    Parameters
    ----------
    given, frames, colour, size : as in `scene_of`
    output : path that ends in .html
    overwrite : replace a page that kickdrift wrote

    Raises
    ------
    InputError
        For bad input, an existing file, and a missing folder. Nothing is written.
    """
    return write_with_scene(given, output, frames, colour, size, overwrite)[0]


def write_with_scene(
    given: Any, output: Any, frames: int | None, colour: str | None, size: float, overwrite: bool
) -> tuple[Path, Scene]:
    """Write the page as `write_page` does. Return its path and its scene."""
    inputs = [given] if isinstance(given, str | os.PathLike) else [getattr(given, "path", None)]
    target = checked_target(output, PAGE, overwrite, inputs)
    with last_stage(f"writing {target}"):
        scene = scene_of(given, frames, colour, size)
        text = page(scene)
    with written_whole(target, PAGE, overwrite=overwrite) as part:
        part.write_text(text, encoding="utf-8")
    return target, scene


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
