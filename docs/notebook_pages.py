"""Notebooks of the site: scripts in docs/notebooks become executed pages, and notebooks to download.

A script has cells. A line ``# %%`` begins a cell of code, ``# %% [markdown]`` one of text, whose lines are comments.
Editors run such cells, git shows them as text, and Python runs the whole script.
"""

from __future__ import annotations

import base64
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "notebooks"
SKIP = "KICKDRIFT_NOTEBOOKS"  # the environment variable that is "source" where nothing is to be executed
SECONDS = 300  # longest time of one cell


def names() -> list[str]:
    """Names of the notebooks."""
    return sorted(path.stem for path in FOLDER.glob("*.py"))


def cells(text: str) -> Iterator[tuple[str, str]]:
    """Kind ("markdown" or "code") and source of each cell of a script."""
    for part in f"\n{text}".split("\n# %%")[1:]:
        head, _, body = part.partition("\n")
        if head.strip() == "[markdown]":
            lines = (line.removeprefix("#").removeprefix(" ") for line in body.strip().split("\n"))
            yield "markdown", "\n".join(lines)
        else:
            yield "code", body.strip()


def notebook(name: str) -> dict[str, Any]:
    """The notebook of a script, not executed, as Jupyter's format 4.5 has it."""
    found = []
    for k, (kind, source) in enumerate(cells((FOLDER / f"{name}.py").read_text(encoding="utf-8"))):
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{k}", "metadata": {}, "source": source}
        found.append(cell if kind == "markdown" else cell | {"execution_count": None, "outputs": []})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": found, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def executed(name: str) -> dict[str, Any]:
    """The notebook of a script with its outputs, run by a kernel in an empty folder."""
    import nbformat
    from nbclient import NotebookClient

    found = nbformat.from_dict(notebook(name))
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(found, timeout=SECONDS, kernel_name="python3", resources={"metadata": {"path": folder}})
        client.execute()
    return found  # type: ignore[no-any-return]


def wanted(name: str) -> dict[str, Any]:
    """The notebook of a script, executed unless the environment says otherwise."""
    return notebook(name) if os.environ.get(SKIP) == "source" else executed(name)


def page(name: str, made: dict[str, Any]) -> tuple[str, dict[str, bytes]]:
    """Page in Markdown of a notebook, and its pictures by name."""
    pictures: dict[str, bytes] = {}
    first, *rest = made["cells"]
    title, _, opening = first["source"].partition("\n")
    parts = [title, f"[Download this notebook]({name}.ipynb){{ .md-button download }}", opening.strip()]
    for cell in rest:
        if cell["cell_type"] == "markdown":
            parts.append(cell["source"])
            continue
        parts.append(f"```python\n{cell['source']}\n```")
        printed = "".join(output["text"] for output in cell["outputs"] if output["output_type"] == "stream")
        if printed.strip():
            parts.append(f"```text\n{printed.rstrip()}\n```")
        for data in (output["data"] for output in cell["outputs"] if "data" in output):
            if "image/png" in data:
                picture = f"{name}-{len(pictures) + 1}.png"
                pictures[picture] = base64.b64decode(data["image/png"])
                parts.append(f"![What this cell draws]({picture})")
            elif "text/plain" in data:
                parts.append(f"```text\n{data['text/plain']}\n```")
    return "\n\n".join(parts) + "\n", pictures
