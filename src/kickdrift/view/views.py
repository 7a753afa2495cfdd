"""Results of ``view()`` of a System, a Simulation and a run: a widget in a notebook, else a page."""

import sys
from typing import Any

from kickdrift.model.checks.values import whole_number
from kickdrift.run.simulation import Simulation
from kickdrift.view.page import HEIGHT, View
from kickdrift.view.scene import scene_of

MISSING = "kickdrift: a view that follows a run needs anywidget: pip install 'kickdrift[notebook]'"


def view_of(
    given: Any, frames: int | None = None, colour: str | None = None, size: float = 1.0, height: int | None = None
) -> Any:
    """View of a System, a Simulation or an open run: a widget in a notebook, else a `View`."""
    height = HEIGHT if height is None else whole_number("view: height", height, 1)
    scene = scene_of(given, frames, colour, size)
    if not in_notebook():
        return View(scene, height)
    try:
        from kickdrift.view.widget import Widget
    except ImportError:
        if isinstance(given, Simulation):
            print(MISSING, file=sys.stderr)
        return View(scene, height)
    found = Widget(scene, height)
    if isinstance(given, Simulation):
        found.follow(given)
    return found


def in_notebook() -> bool:
    """Whether the program runs in a notebook: IPython with a kernel, or marimo."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if shell is not None and getattr(shell, "kernel", None) is not None:
        return True
    marimo: Any = sys.modules.get("marimo")
    return bool(marimo is not None and marimo.running_in_notebook())
