"""Standard error of a command without the lines about what it compiled, which depend on earlier runs, and without lines
of progress, which slow machines print."""

import re

PROGRESS = re.compile(r".+: \d+ %(, .*)?$|.+ …$")


def without_compiling(err: str) -> str:
    """The lines that do not say what is compiled, or how far the work is."""
    lines = (line for line in err.splitlines(keepends=True) if line.split()[:1] != ["compiling"])
    return "".join(line for line in lines if not PROGRESS.fullmatch(line.rstrip("\n")))
