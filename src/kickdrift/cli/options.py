"""Arguments and options of several commands."""

from pathlib import Path
from typing import Annotated

import typer

from kickdrift.errors import InputError

SystemArgument = Annotated[
    str, typer.Argument(metavar="SYSTEM.toml", help="A system file, or the name of a shipped system.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as one JSON object.")
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that kickdrift wrote.")]
ThreadsOption = Annotated[int, typer.Option(metavar="K", min=1, help="Threads; they do not change the results.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print only errors on standard error.")]
RtolOption = Annotated[
    str | None, typer.Option(metavar="X", help="Relative tolerance of adaptive methods; X,X,… for each unknown.")
]
AtolOption = Annotated[
    str | None, typer.Option(metavar="X", help="Absolute tolerance of adaptive methods; X,X,… for each unknown.")
]
FlushOption = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS", help="Seconds between writes to disk; a kill loses at most this much (default 10)."
    ),
]


def tolerance(key: str, text: str | None) -> float | list[float] | None:
    """Parse a tolerance: one number, or several with commas between them."""
    if text is None:
        return None
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--{key}: expected a number, or numbers with commas between them, got {text!r}") from None
    return found if "," in text else found[0]
