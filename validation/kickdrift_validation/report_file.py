"""The report of a validation: what was claimed, measured and found, and with what, as one page of Markdown."""

import os
import platform
import re
import shutil
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from kickdrift.disk.kinds import Kind, is_ours
from kickdrift.disk.outputs import written_whole
from kickdrift.engines import ENGINES
from kickdrift.errors import InputError
from kickdrift.text import counted, duration
from kickdrift_validation.claim import Claim, text_of
from kickdrift_validation.folders import CHECKOUT
from kickdrift_validation.registry import SCRIPTS, Script


class Outcome(NamedTuple):
    """A script's claims, its seconds and the figures that it saved."""

    script: Script
    claims: list[Claim]
    seconds: float
    figures: list[Path]

    def count(self) -> Counter[str]:
        """The number of claims by their verdict."""
        return Counter(str(row["verdict"]) for row in self.claims)


MARK = "<!-- written by `kickdrift validate`: not to be edited -->"
REPORT = Kind("a report of kickdrift validate", (), lambda head, tail: head.startswith(MARK.encode()), streams=False)
OURS = ("kickdrift", "numpy", "numba", "scipy", "h5py", "matplotlib")
SIGNS = {"pass": "pass", "fail": "**fail**", "not run": "not run"}


def target(given: Path | None, whole: bool) -> Path:
    """Where the report goes: what was asked for; else validation/REPORT.md for a whole run in a checkout, and in
    ./validation-report otherwise. A file, or figures, that are no report's are never replaced (InputError)."""
    path = given or (CHECKOUT / "validation" if whole and CHECKOUT else Path("validation-report")) / "REPORT.md"
    there = os.path.lexists(path)
    if not there and any((path.parent / "figures").glob("*.png")):
        raise InputError(f"--report {path}: the figures beside it are of no report; choose another folder")
    if there and (path.is_symlink() or not is_ours(path, REPORT)):
        raise InputError(f"--report {path}: exists and is no report of kickdrift validate; it is not replaced")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--report {path}: {(error.strerror or str(error)).lower()}") from None
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"--report {path}: {path.parent} cannot be written to")
    return path


def write(path: Path, found: Sequence[Outcome], *, long: bool, seconds: float, jobs: int) -> None:
    """Write the report whole, its figures into the folder ``figures`` beside it."""
    folder = path.parent / "figures"
    for name in _figures_of(path):
        (folder / name).unlink(missing_ok=True)
    for outcome in found:
        for figure in outcome.figures:
            folder.mkdir(exist_ok=True)
            (folder / figure.name).unlink(missing_ok=True)  # a symbolic link is not followed
            shutil.copyfile(figure, folder / figure.name)
    text = "\n".join([MARK, "", *_summary(found, long, seconds, jobs), *_sections(found)]) + "\n"
    with written_whole(path, REPORT, overwrite=True) as part:
        part.write_text(text, encoding="utf-8")


def _figures_of(path: Path) -> list[str]:
    """The figures that an earlier report there shows; none of what is no report."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return re.findall(r"\]\(figures/([^)/]+\.png)\)", text) if text.startswith(MARK) else []


def _summary(found: Sequence[Outcome], long: bool, seconds: float, jobs: int) -> list[str]:
    from kickdrift.analysis.compare.bench import processor  # loads numba

    total = sum((outcome.count() for outcome in found), Counter[str]())
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    machine = f"{processor()}, {counted(os.cpu_count() or 1, 'core')}, {platform.system()} {platform.machine()}"
    lines = [
        "# Validation",
        "",
        f"**{counted(total.total(), 'claim')}: {', '.join(f'{total[each]} {each}' for each in SIGNS)}.**",
        "",
        "Each line is a claim: what was measured here, the bound that it must keep, and where the truth, or the other",
        "side of the comparison, comes from.",
        f"Made by `kickdrift validate{' --long' if long else ''}`, which makes it anew.",
        "",
        *_untested(),
        "| | |",
        "| --- | --- |",
        f"| date | {now} |",
        f"| machine | {machine} |",
        f"| set | {'long' if long else 'short'} |",
        f"| time | {duration(seconds)}, {counted(jobs, 'script')} at a time |",
        f"| python | {platform.python_version()} |",
        *(f"| {name} | {_version(name)} |" for name in (*OURS, *_peers())),
        "",
        "| script | shows | claims | pass | fail | not run | seconds |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for outcome in found:
        count, script = outcome.count(), outcome.script
        numbers = (count.total(), count["pass"], count["fail"], count["not run"], f"{outcome.seconds:.0f}")
        shows = script.shows[0].upper() + script.shows[1:]
        lines.append(f"| [{script.name}](#{script.name}) | {cell(shows)} | {' | '.join(map(str, numbers))} |")
    return lines


def _sections(found: Sequence[Outcome]) -> list[str]:
    lines = []
    for outcome in found:
        script = outcome.script
        lines += ["", f"## {script.name}", "", f"{script.shows[0].upper()}{script.shows[1:]} (`{script.file}`)."]
        lines += _table(outcome.claims)
        lines += [line for figure in outcome.figures for line in ("", f"![{figure.stem}](figures/{figure.name})")]
    return lines


def _table(rows: Sequence[Claim]) -> list[str]:
    lines = ["", "| claim | value | bound | reference | verdict |", "| --- | --- | --- | --- | --- |"]
    for row in rows:
        texts = (str(row["claim"]), text_of(row["value"]), str(row["bound"]), str(row["reference"]))
        lines.append(f"| {' | '.join(cell(text) for text in texts)} | {SIGNS[str(row['verdict'])]} |")
    return lines


def cell(text: str) -> str:
    """Text that cannot end a table's cell."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def _peers() -> list[str]:
    return sorted({peer for script in SCRIPTS for peer in script.peers}, key=str.lower)


def _untested() -> list[str]:
    """Programs that the scripts compare with, in versions that the tests have not run with."""
    warnings = [line for each in ENGINES.values() if {*each.needs[:1]} & {*_peers()} for line in each.warnings]
    return [f"**Note:** {'; '.join(warnings)}.", ""] if warnings else []


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
