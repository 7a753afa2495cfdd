"""What the site shows and no page holds: the command line's own help, the report of the validation, and notebooks."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

TOP = Path(__file__).parents[1]
REPORT = TOP / "validation" / "REPORT.md"


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made here."""
    files.append(File.generated(config, "command-line.md", content=command_line()))
    files.append(File.generated(config, "report.md", content=REPORT.read_text(encoding="utf-8")))
    for figure in sorted((REPORT.parent / "figures").glob("*.png")):
        files.append(File.generated(config, f"figures/{figure.name}", abs_src_path=str(figure)))
    sys.path.insert(0, str(TOP / "docs"))
    import gallery_page
    import notebook_pages

    last: dict[str, bytes] = {}
    for name in notebook_pages.names():
        made = notebook_pages.wanted(name)
        text, pictures = notebook_pages.page(name, made)
        if pictures:
            last[name] = [*pictures.values()][-1]
        whole = json.dumps(made, indent=1, ensure_ascii=False)
        for file, content in {f"{name}.md": text, f"{name}.ipynb": whole, **pictures}.items():
            files.append(File.generated(config, f"notebooks/{file}", content=content))
    text, thumbnails = gallery_page.gallery(last)
    for file, content in {"gallery.md": text, **thumbnails}.items():
        files.append(File.generated(config, file, content=content))
    return files


def command_line() -> str:
    """The help page of every command."""
    import typer

    from kickdrift.cli.help import pages
    from kickdrift.cli.main import app

    parts = ["# The command line", "`kickdrift COMMAND --help` prints these pages."]
    for name, page in pages(typer.main.get_command(app), "kickdrift"):
        parts += [f"## {name}", f"```text\n{page}\n```"]
    return "\n\n".join(parts) + "\n"
