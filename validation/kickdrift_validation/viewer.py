"""Pages of kickdrift view in a real browser: do they draw, move and answer, and do they stay by themselves?

    python -m kickdrift_validation.viewer [--figures FOLDER] [--store]

Chromium without a window, which draws on the processor alone, opens the page of five runs from disk: a liquid, a
mixture, the solar system, a collision, and a leaning box. Names in the collision hold markup, which has to
stay text. The first frame's picture is compared with a stored one (data/viewer); ``--store`` stores the pictures anew.
The comparison takes the particles, the box and the orbits alone, since letters differ between machines. The figure
shows the pages of the mixture and of the planets.
"""

import base64
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.view.page import write_page
from kickdrift_validation.claim import Claim, claim, main, not_run

MARKUP = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"


def leaning() -> kd.System:
    """A Lennard-Jones liquid in a box whose edges lean, from a lattice that leans alike."""
    box = kd.Box(matrix=[[7.4, 0, 0], [-3.0, 7.4, 0], [2.8, 2.4, 7.4]])
    parts = (np.indices((7, 7, 7)).reshape(3, -1).T + 0.5) / 7
    v = np.random.default_rng(4).normal(size=parts.shape)
    return kd.System(
        parts @ box.matrix, v - v.mean(axis=0), box=box, forces=[kd.LennardJones(cutoff=2.5)], name="leaning box"
    )


def colliding() -> kd.System:
    """Two planets that go round a star in opposite directions and meet, and one outside. The names hold markup."""
    x = [[0.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [0.0, -1.7, 0.2]]
    v = [[0.0, 0, 0], [0.0, 1.0, 0], [0.0, 1.0, 0], [0.77, 0, 0]]
    return kd.System(
        x, v, [1.0, 1e-3, 5e-4, 1e-3], forces=[kd.Gravity()], units="nbody", radii=[0.02, 0.05, 0.04, 0.05],
        names=["Star", "<b>b</b>", "c", "d"], events=[kd.Collision()], name=MARKUP,
    )  # fmt: skip


def mixed() -> kd.Simulation:
    """A mixture of two species in equilibrium."""
    sim = kd.Simulation(kd.load("lj-binary-1000"))
    sim.equilibrate(temperature=1.0, steps=400)
    return sim


def runs(folder: Path) -> dict[str, Path]:
    """Write the runs' files; return their paths by name."""
    plans = {
        "liquid": (kd.Simulation(kd.load("lj-1000")), {"steps": 1000, "every": 5}),
        "mixture": (mixed(), {"steps": 200, "every": 5}),
        "planets": (kd.Simulation(kd.load("solar-system")), {"steps": 2400, "every": 20}),
        "collision": (kd.Simulation(colliding(), "gauss-radau15"), {"until": 8.0, "interval": 0.02}),
        "leaning": (kd.Simulation(leaning(), dt=0.004), {"steps": 200, "every": 5}),
    }
    made = {}
    for name, (sim, plan) in plans.items():
        made[name] = folder / f"{name}.h5md"
        sim.run(**plan, output=made[name])  # type: ignore[arg-type]
    return made


STORED = Path(__file__).parent / "data" / "viewer"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SOFTWARE = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SIZE = {"width": 1000, "height": 640}
DIFFERENT = 24  # of 255: a pixel that differs by more in a colour counts as another one
MOST = 0.01  # share of the pixels that may differ: edges of spheres, which a rounding of the graphics moves
PACE = 30.0  # frames a second
WAITS = 1200  # for a page to begin, 50 ms each
TRIES = 4  # of the pace, 3 s each; the best counts, since other programs share the machine
CHROMIUM = "Chromium"
SHOWN, GAP = ("mixture", "planets"), 10  # in the figure, and pixels between its parts

# The picture of frame 0 at one pixel a point, as PNG text; of the canvas alone.
PICTURE = """() => {
  const {drawing} = view;
  drawing.theme = {background: "#f6f7f9", ink: "#20262e", box: "#5c6672"};
  view.setFrame(0); drawing.reset(); drawing.resolution(1); drawing.render();
  return drawing.canvas.toDataURL("image/png");
}"""


def pixels(png: bytes) -> np.ndarray:
    """Colours (height, width, 3) of a picture."""
    from PIL import Image

    return np.asarray(Image.open(BytesIO(png)).convert("RGB")).astype(int)


class Page:
    """A page in the browser, and what it said and asked for."""

    def __init__(self, browser: Any, path: Path) -> None:
        self.context = browser.new_context(viewport=SIZE, color_scheme="light")
        self.tab = self.context.new_page()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.tab.on("console", lambda said: said.type == "error" and self.errors.append(said.text))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.on("dialog", lambda dialog: (self.errors.append(f"dialog {dialog.message}"), dialog.dismiss()))
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.goto(path.as_uri())
        for _ in range(WAITS):
            if self.ask("globalThis.view?.count > 0"):  # before, `view` is the element of that id
                break
            self.tab.wait_for_timeout(50)
        self.address = path.as_uri()

    def ask(self, script: str, given: Any = None) -> Any:
        return self.tab.evaluate(script, given)

    def picture(self) -> bytes:
        return base64.b64decode(self.ask(PICTURE).partition(",")[2])

    @property
    def outside(self) -> list[str]:
        """What the page asked for, beside itself."""
        return [url for url in self.requests if url != self.address and not url.startswith(("data:", "blob:"))]

    @property
    def frame(self) -> int:
        return int(self.ask("view.frame"))


def keys_work(page: Page) -> dict[str, bool]:
    """Which keys do what they should."""
    press, last, found = page.tab.keyboard.press, int(page.ask("view.count")) - 1, {}
    for key, frame in (
        ("End", last),
        ("ArrowLeft", last - 1),
        ("Home", 0),
        ("ArrowRight", 1),
        ("Shift+ArrowRight", 11),
    ):
        press(key)
        found[key] = page.frame == frame
    press("Home")
    press(" ")
    page.tab.wait_for_timeout(700)
    found["space"] = bool(page.ask("view.plays")) and page.frame > 0
    press(" ")
    found["space again"] = not page.ask("view.plays")
    before = page.ask("view.drawing.camera.position.toArray()")
    page.tab.mouse.move(420, 300)
    page.tab.mouse.down()
    page.tab.mouse.move(520, 330, steps=4)
    page.tab.mouse.up()
    moved = page.ask("view.drawing.camera.position.toArray()")
    found["drag"] = not np.allclose(before, moved, rtol=1e-3)
    press("r")
    found["r"] = bool(np.allclose(page.ask("view.drawing.camera.position.toArray()"), before, rtol=1e-6))
    press("d")
    found["d"] = page.ask("view.root.dataset.theme") == "dark"
    press("d")
    press("?")
    found["?"] = page.tab.get_by_text("Keys and touch").is_visible()
    press("?")
    with page.tab.expect_download() as download:
        press("s")
    saved = pixels(Path(download.value.path()).read_bytes())
    found["s"] = saved.std() > 1.0 and saved.shape[0] > SIZE["height"]
    return found


def pointers_work(page: Page) -> dict[str, bool]:
    """Whether a click on the slider, on a curve and on the play button moves the frame."""
    count, found = int(page.ask("view.count")), {}
    for name, place in (
        ("slider", page.tab.get_by_label("Time", exact=True)),
        ("curve", page.tab.locator(".plot").first),
    ):
        page.ask("view.setFrame(0)")
        box = place.bounding_box()
        page.tab.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + box["height"] / 2)
        found[name] = abs(page.frame - count / 2) < 0.06 * count
    page.tab.locator("[data-act=play]").click()
    page.tab.wait_for_timeout(600)
    found["play button"] = bool(page.ask("view.plays"))
    page.ask("view.pause()")
    before = page.picture()
    page.tab.get_by_role("combobox").first.select_option("speed")
    found["colour menu"] = bool((pixels(page.picture()) != pixels(before)).any())
    page.ask("view.setColour(view.scene.colour)")
    return found


def functions_work(page: Page) -> dict[str, bool]:
    """Whether the functions for widgets and live pages work. The page is empty afterwards."""
    append = (
        "async () => { const n = view.count; await view.append(view.scene.chunks[0]); return view.count === 2 * n }"
    )
    found = {
        "append": bool(page.ask(append)),
        "snapshot": page.ask("async () => (await view.snapshot()).type") == "image/png",
    }
    page.ask("view.dispose()")
    return found | {"dispose": page.ask("document.getElementById('view').childElementCount") == 0}


def pace(page: Page) -> float:
    """Frames drawn per second while the run plays."""
    best = 0.0
    for _ in range(TRIES):
        page.ask("view.pause(); view.setFrame(0); view.speed = 0.5; view.play()")
        page.tab.wait_for_timeout(3000)
        best = max(best, float(page.ask("view.fps")))
        if best >= PACE:
            break
    page.ask("view.pause()")
    return best


def halved(png: bytes) -> bytes:
    """The picture at half its width and height, each pixel the mean of four."""
    from PIL import Image

    made = BytesIO()
    Image.open(BytesIO(png)).convert("RGB").reduce(2).save(made, "png", optimize=True)
    return made.getvalue()


def beside(shots: list[bytes], path: Path) -> None:
    """Save pictures of one size side by side."""
    from PIL import Image

    parts = [Image.open(BytesIO(png)).convert("RGB") for png in shots]
    wide, high = parts[0].size
    whole = Image.new("RGB", (wide * len(parts) + GAP * (len(parts) - 1), high), "white")
    for k, part in enumerate(parts):
        whole.paste(part, (k * (wide + GAP), 0))
    whole.save(path, optimize=True)


def like_stored(name: str, png: bytes, store: bool) -> float:
    """Share of pixels, at half the size, that differ from the stored picture."""
    path, png = STORED / f"{name}.png", halved(png)
    if store:
        path.write_bytes(png)
    now, then = pixels(png), pixels(path.read_bytes())
    return float((np.abs(now - then).max(axis=2) > DIFFERENT).mean()) if now.shape == then.shape else 1.0


def looked_at(browser: Any, name: str, path: Path, store: bool, shots: list[bytes]) -> Iterator[Claim]:
    """The claims about one page. ``shots`` gets pictures for the figure."""
    page = Page(browser, path)
    png = page.picture()
    spread = float(pixels(png).std())
    yield claim(f"{name}: spread of the picture's colours", spread, "above 5 of 255", spread > 5, CHROMIUM)
    share = like_stored(name, png, store)
    text = f"{name}: share of pixels unlike the stored picture's"
    yield claim(text, share, f"at most {MOST}", share <= MOST, "data/viewer")
    if name in SHOWN:
        dark = name == "planets"
        page.ask("dark => { view.themed(dark ? 'dark' : 'light'); view.setFrame(Math.round(0.6 * view.count)) }", dark)
        page.tab.wait_for_timeout(1500)
        shots.append(page.tab.screenshot())
        page.ask("view.themed('light')")
    if name == "liquid":
        fps = pace(page)
        text = "liquid: frames a second, 1000 particles, software rendering"
        yield claim(text, round(fps, 1), f"{PACE:.0f} or more", fps >= PACE, CHROMIUM)
        found = keys_work(page) | pointers_work(page)
        found |= functions_work(page)
        failed = [key for key, works in found.items() if not works]
        yield claim(
            f"keys and controls that fail, of {len(found)}", ", ".join(failed) or "none", "none", not failed, CHROMIUM
        )
    if name == "collision":
        title, image = page.tab.locator(".title").text_content(), page.tab.locator(".view img, .name b").count()
        yield claim("markup in a title stays text", title, "the title", title == MARKUP and not image, CHROMIUM)
        gone = page.ask("[0, view.count - 1].map((k) => view.setFrame(k) ?? view.drawing.render() ?? "
                        "view.drawing.spheres.geometry.drawRange.count / 6)")  # fmt: skip
        yield claim(
            "bodies drawn first and last", gone, "fewer at the end", gone[0] == 4 and gone[1] < 4, "the run's events"
        )
    heard = [*page.errors, *(f"asks for {url}" for url in page.outside)]
    yield claim(f"{name}: errors and requests", "; ".join(heard)[:200] or "none", "none", not heard, CHROMIUM)
    page.context.close()


def claims(long: bool = False, figures: Path | None = None) -> Iterator[Claim]:
    return tried(figures, store=False)


def tried(figures: Path | None, store: bool) -> Iterator[Claim]:
    """Claims about all pages; with ``store`` the pictures are stored anew."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        yield not_run("pages in a browser", "all claims", CHROMIUM)
        return
    if program is None:
        yield not_run(
            "pages in a browser", "all claims", CHROMIUM, "install Chromium, such as Debian's package chromium"
        )
        return
    shots: list[bytes] = []
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=list(SOFTWARE))
        for name, run in runs(Path(scratch)).items():
            page = write_page(run, run.with_suffix(".html"))
            size = os.path.getsize(page)
            yield claim(f"{name}: size of the page in MB", size / 1e6, "below 5", size < 5e6, "the file")
            yield from looked_at(browser, name, page, store, shots)
        browser.close()
    if figures:
        beside(shots, figures / "viewer.png")


if __name__ == "__main__":
    if "--store" in sys.argv:
        sys.argv.remove("--store")
        STORED.mkdir(exist_ok=True)
        list(tried(None, store=True))
    main(claims, __doc__)
