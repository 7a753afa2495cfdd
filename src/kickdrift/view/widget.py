"""The view as a widget of a notebook: JupyterLab, VS Code and marimo show it through anywidget."""

import json
from typing import Any

import anywidget
import traitlets

from kickdrift.view.live import END, NEWEST, Feed
from kickdrift.view.page import HEIGHT, View, bundle
from kickdrift.view.scene import Scene

# A message that comes before the view is mounted waits.
RENDER = """
async function render({model, el}) {
  const inside = document.createElement("div");
  inside.style.height = model.get("height") + "px";
  el.append(inside);
  const scene = JSON.parse(model.get("scene"));
  const mounting = globalThis.kickdriftView.mount(inside, scene, {live: model.get("live")});
  const show = newest(async (frame) => (await mounting).append(frame));
  const hear = async ({kind, content}) => {
    const view = await mounting;
    if (kind === "told") {
      inside.dataset.step = content.step;
      view.say(content.text);
      await view.addCurves(content.curves);
    } else if (kind === "frame") {
      await show(content);
    }
  };
  model.on("msg:custom", hear);
  const view = await mounting;
  if (scene.status) view.say(scene.status);
  return () => { model.off("msg:custom", hear); view.dispose(); };
}
export default {render};
"""


class Widget(anywidget.AnyWidget):
    """A view in a notebook. A Simulation's view goes on while the Simulation runs.

    Attributes
    ----------
    scene : JSON text of the scene
    height : of the view, in pixels
    """

    _esm = bundle() + NEWEST + RENDER
    scene = traitlets.Unicode("{}").tag(sync=True)
    live = traitlets.Bool(False).tag(sync=True)
    height = traitlets.Int(HEIGHT).tag(sync=True)

    def __init__(self, scene: Scene, height: int = HEIGHT) -> None:
        super().__init__(scene=as_text(scene), height=height)
        self._feed: Feed | None = None

    def follow(self, sim: Any) -> None:
        """Show the Simulation whenever it runs."""
        self._feed = Feed(sim, self._hear)
        self.live = True
        sim.followers.append(self._feed)

    def _hear(self, kind: str, content: dict[str, Any]) -> None:
        """Pass a message on to the browser; a view that is shown later begins with the last frame."""
        self.send({"kind": kind, "content": content})
        if kind == END and self._feed is not None:
            self.scene = as_text(self._feed.scene())

    def save(self, path: Any, overwrite: bool = False) -> Any:
        """Write the view as a page of its own; return the page's path."""
        return View(json.loads(self.scene), self.height).save(path, overwrite)


def as_text(scene: Scene) -> str:
    return json.dumps(scene, allow_nan=False, separators=(",", ":"))
