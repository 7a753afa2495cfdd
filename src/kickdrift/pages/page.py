"""One HTML file of a page that computes, which needs neither Python nor a network."""

import html
import json
import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

from kickdrift.disk.kinds import PAGE
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.errors import InputError
from kickdrift.pages.linking import linker
from kickdrift.pages.lowering import PLAIN_PROCESSOR
from kickdrift.pages.shipped import page_of
from kickdrift.view.page import POLICY, as_json, bundle

# WebAssembly is compiled in the page, and nothing else that a script could make
POLICY_OF_PAGES = POLICY.replace("script-src 'unsafe-inline'", "script-src 'unsafe-inline' 'wasm-unsafe-eval'")
SHARED = ("runtime.js", "drawing.js", "verdict.js")
TEXT = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="kickdrift page">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title} · kickdrift</title>
<style>{style}</style>
</head>
<body>
<header><h1>{title}</h1><button id="theme" type="button">Dark or light</button></header>
<p class="about">{about}</p>
<main id="page"><noscript>This page needs JavaScript.</noscript></main>
<details><summary>The same in Python</summary><pre id="python"></pre></details>
<footer>The loops in this page are those of kickdrift, compiled to WebAssembly. Nothing is loaded or sent.</footer>
<script type="application/json" id="module">{module}</script>
{viewer}<script type="module">{script}</script>
</body>
</html>
"""


def built(name: str) -> dict[str, Any]:
    """Module of a page as plain texts and numbers. Raises InputError if there is no such page or no linker."""
    page_of(name)
    linker()
    command = [sys.executable, "-P", "-m", "kickdrift.pages.build", name]  # -P: no module of the present folder
    done = subprocess.run(command, env=os.environ | PLAIN_PROCESSOR, capture_output=True, text=True)
    if done.returncode:
        raise InputError((done.stderr.strip().splitlines() or ["page: the build failed"])[-1])
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def write_page(name: str, output: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a page that computes. Return its path.

    Parameters
    ----------
    name : one of `PAGES`, the name of a shipped system of particles, or the path of a system file
    output : path that ends in .html
    overwrite : replace a page that kickdrift wrote

    Raises
    ------
    InputError
        For an unknown page, a system that a page cannot hold, an existing file, and a missing linker. Nothing is
        written.
    """
    page = page_of(name)
    target = checked_target(output, PAGE, overwrite, [name])
    scripts = "\n".join(_asset(each).replace("export ", "") for each in (*SHARED, page.script))
    shown = page.shown() if page.shown else {}
    text = TEXT.format(
        policy=POLICY_OF_PAGES,
        title=html.escape(page.title),
        about=html.escape(page.about),
        style=_asset("page.css"),
        module=as_json({**built(name), "python": page.python, **shown}),
        viewer=f'<script type="module">{bundle()}</script>\n' if "scene" in shown else "",
        script=scripts,
    )
    with written_whole(target, PAGE, overwrite=overwrite) as part:
        part.write_text(text, encoding="utf-8")
    return target


def _asset(name: str) -> str:
    return (files("kickdrift.pages") / "assets" / name).read_text(encoding="utf-8")
