"""What a case may not do, whatever its kind."""

import re
from dataclasses import dataclass, field

LONGEST_LINE = 700  # characters on standard error
KILLED = "killed, as the case asks"
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
PROGRESS = re.compile(r"(?!kickdrift: )(compiling .*|.*( …|: \d+ %.*))$")  # a line about work that takes long
CULPRIT = re.compile(r'File ".*?/(kickdrift/[\w/.]+)", line (\d+), in (\S+)')


@dataclass
class Ended:
    """What came of one command.

    Attributes
    ----------
    status : int
        Exit status; negative the signal that ended the process.
    stopped : str
        The reason for which the zygote ended the process, else "".
    computing : bool
        Whether the process was computing a run when it was stopped.
    notes : list of str
        What the process touched that is none of its business.
    """

    command: tuple[str, ...]
    status: int
    out: str
    err: str
    seconds: float = 0.0
    megabytes: float = 0.0
    stopped: str = ""
    computing: bool = False
    notes: list[str] = field(default_factory=list)


def broken(ended: Ended, statuses: tuple[int, ...] = (0, 1, 2), may_compute: bool = False) -> list[str]:
    """The rules that a command broke, in words."""
    found = [f"touched: {note}" for note in ended.notes]
    if ended.stopped == KILLED:
        return found
    lines = [line for line in ended.err.splitlines() if line.strip()]
    if "Traceback (most recent call last)" in ended.err + ended.out:
        found.append(f"traceback: {culprit(ended.err)}")
    elif ended.stopped and not (may_compute and ended.computing and ended.status in (0, 130)):
        found.append(f"{ended.stopped}{', while it computed a run' if ended.computing else ''}")
    elif ended.status < 0:
        found.append(f"signal {-ended.status}")
    elif not ended.stopped:
        if ended.status not in statuses:
            found.append(f"exit status {ended.status} where {' or '.join(map(str, statuses))} is right")
        if ended.status == 2 and not usage(ended):
            found += error_lines(lines)
        if ended.status == 1 and len(lines) > 10:
            found.append(f"{len(lines)} lines of error")
    if warning := next((line for line in lines if re.search(r"\w*Warning: |Exception ignored|Fatal Python", line)), ""):
        found.append(f"warning: {short(warning)}")
    if match := CONTROL.search(ended.out + ended.err):
        found.append(f"control character {match[0]!a} is printed")
    longest = max((len(line) for line in lines), default=0)
    if longest > LONGEST_LINE:
        found.append(f"line longer than {LONGEST_LINE} characters on standard error")
    return found


def usage(ended: Ended) -> bool:
    """Whether a command without arguments showed its help, as typer does."""
    return not ended.err.strip() and "Usage:" in ended.out


def error_lines(lines: list[str]) -> list[str]:
    """What is wrong with the standard error of exit status 2."""
    errors = [line for line in lines if not line.startswith("warning: ") and not PROGRESS.match(line)]
    if len(errors) == 1 and errors[0].startswith("kickdrift: "):
        return []
    if not errors:
        return ["exit status 2 without a line of error"]
    if len(errors) == 1:
        return ["error line does not begin with the program's name"]
    return [f"{len(errors)} lines of error: {short(errors[0])}"]


def culprit(text: str) -> str:
    """The error and the place in kickdrift that a traceback ends with."""
    places = CULPRIT.findall(text)
    error = re.findall(
        r"^(?:\w+\.)*(\w*(?:Error|Exception|Interrupt|Warning|Exit|Timeout)\w*)\b(.*)$", text, re.MULTILINE
    )
    last = "".join(error[-1]) if error else text.strip().splitlines()[-1]
    where = f" in {places[-1][0]}, {places[-1][2]}" if places else ""
    return short(last) + where


def short(text: str, most: int = 160) -> str:
    """The text in one line, cut, with control characters as escapes."""
    plain = " ".join(CONTROL.sub(lambda match: ascii(match[0])[1:-1], text).split())
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def signature(text: str) -> str:
    """A finding without its numbers and names: findings with one cause have one signature."""
    kind, _, rest = text.partition(": ")
    if kind == "traceback":
        error, _, where = rest.rpartition(" in kickdrift/")
        return f"traceback: {error.split(':')[0]} in {where}" if error else f"traceback: {rest.split(':')[0]}"
    return re.sub(r"'[^']*'|\d[\d.e+-]*", "…", text)
