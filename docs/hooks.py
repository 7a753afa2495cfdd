"""What the site shows and no page holds: the command line's own help, and the report that the validation wrote."""

from __future__ import annotations

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
