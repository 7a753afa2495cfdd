"""Standard error of a command without the lines about what it compiled, which depend on earlier runs."""


def without_compiling(err: str) -> str:
    """The lines that do not say what is compiled."""
    return "".join(line for line in err.splitlines(keepends=True) if line.split()[:1] != ["compiling"])
