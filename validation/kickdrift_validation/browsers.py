"""Chromium without a window, for the scripts that look at pages."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import numpy as np

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
NEEDS = "pip install playwright, and a Chromium"
# Software rendering, so that pictures do not depend on the machine.
GIVEN = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def opened(width: int = 1200, height: int = 800) -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=CHROMIUM, args=list(GIVEN))
        yield browser.new_page(viewport={"width": width, "height": height})
        browser.close()


def colours_of(picture: bytes) -> int:
    """Number of colours in a PNG picture."""
    from matplotlib.image import imread

    pixels = np.asarray(imread(BytesIO(picture), format="png"))[..., :3]
    return len(np.unique((pixels * 255).astype(np.uint8).reshape(-1, 3), axis=0))
