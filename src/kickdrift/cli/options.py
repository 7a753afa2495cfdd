"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from kickdrift.errors import InputError

SystemArgument = Annotated[
    str, typer.Argument(metavar="SYSTEM.toml", help="A system file, or the name of one that ships.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as one JSON object.")
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that kickdrift wrote.")]
ThreadsOption = Annotated[int, typer.Option(metavar="K", min=1, help="Threads; the results do not depend on it.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Nothing on standard error but errors.")]
RtolOption = Annotated[
    str | None, typer.Option(metavar="X", help="Relative tolerance of adaptive methods; X,X,… one for each unknown.")
]
AtolOption = Annotated[
    str | None, typer.Option(metavar="X", help="Absolute tolerance of adaptive methods; X,X,… one for each unknown.")
]
FlushOption = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Of frames that a kill costs at most (default 10).")
]


def tolerance(key: str, text: str | None) -> float | list[float] | None:
    """A tolerance as the command line gives it: a number, or some with commas between them."""
    if text is None:
        return None
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--{key}: expected a number, or numbers with commas between them, got {text!r}") from None
    return found if "," in text else found[0]
