"""Runs the validation's scripts, each in a process of its own, shows how it goes, and has the report written."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from queue import Empty, Queue
from threading import Event, Thread
from time import monotonic
from typing import IO, Any, NamedTuple

from kickdrift.cli.console import out, print_table
from kickdrift.display.pace import Pace, print_line
from kickdrift.errors import InputError
from kickdrift.text import counted, duration
from kickdrift_validation import report_file
from kickdrift_validation.claim import INSTALL, Claim, claim, not_run, text_of
from kickdrift_validation.registry import SCRIPTS, Script
from kickdrift_validation.report_file import Outcome

PACKAGE = __name__.rpartition(".")[0]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
LONGEST = 1200.0  # seconds that a script of the short set may take
VERDICTS = ("pass", "fail", "not run")
ITSELF = "the script itself"  # the reference of a claim that the runner adds: a crash, or the time limit


class _Running(NamedTuple):
    process: subprocess.Popen[str]
    messages: IO[str]
    figures: Path
    began: float
    claims: list[Claim]


def chosen(names: Sequence[str], scripts: Sequence[Script] = SCRIPTS) -> list[Script]:
    """The scripts of these names; without any all."""
    if not names:
        return list(scripts)
    wanted = set()
    for name in names:
        plain = re.split(r"[/.]", name.removesuffix(".py").replace("_", "-"))[-1]
        found = [script for script in scripts if plain == script.name]
        if not found:
            known = [script.name for script in scripts]
            near = get_close_matches(plain, known, 3)
            meant = f"did you mean {' or '.join(near)}? " if near else ""
            raise InputError(f"validate: {name!r} is no script; {meant}there are: {', '.join(known)}")
        wanted |= set(found)
    return [script for script in scripts if script in wanted]


def outcomes(
    scripts: Sequence[Script],
    scratch: Path,
    long: bool = False,
    jobs: int = 2,
    *,
    package: str = PACKAGE,
    limit: float | None = None,
    environment: Mapping[str, str] | None = None,
    tell: Callable[[Script, Claim | None], None] = lambda script, row: None,
    stop: Event | None = None,
) -> Iterator[Outcome]:
    """Each script's outcome as it ends, ``jobs`` at a time and the slowest first.

    The scripts are modules of ``package``. ``tell`` hears of every script that begins (with None) and of every claim.
    Figures go to folders of ``scratch``.
    What takes more than ``limit`` seconds is ended. All processes are ended when the iteration is, or once ``stop`` is
    set.
    """
    waiting = deque(sorted(scripts, key=lambda script: -script.seconds))
    running: dict[Script, _Running] = {}
    heard: Queue[tuple[Script, str | None]] = Queue()
    try:
        while (waiting or running) and not (stop and stop.is_set()):
            while waiting and len(running) < jobs:
                script = waiting.popleft()
                running[script] = _start(script, package, scratch, long, environment, heard)
                tell(script, None)
            late = [s for s, run in running.items() if limit is not None and monotonic() - run.began > limit]
            for script, run in running.items():
                if script in late or run.process.poll() is not None:  # what it leaves behind may keep the pipe open
                    _end(run.process)
            try:
                script, line = heard.get(timeout=0.5)
            except Empty:
                continue
            run = running[script]
            if line is None:
                _end(run.process)
                yield _outcome(script, running.pop(script), limit if script in late else None, tell)
            else:
                run.claims.append(json.loads(line))
                tell(script, run.claims[-1])
    finally:
        for run in running.values():
            _end(run.process)
            run.messages.close()


def _start(
    script: Script, package: str, scratch: Path, long: bool, environment: Mapping[str, str] | None,
    heard: Queue[tuple[Script, str | None]],
) -> _Running:  # fmt: skip
    figures = scratch / script.name
    figures.mkdir(parents=True)
    messages = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115
    module = f"{package}.{script.module}"  # -P: the working folder holds no module of ours
    words = [sys.executable, "-P", "-m", f"{PACKAGE}.child", module, str(figures)]
    process = subprocess.Popen(
        words + ["--long"] * long, stdout=subprocess.PIPE, stderr=messages, stdin=subprocess.DEVNULL, text=True,
        encoding="utf-8", env={**os.environ, **ONE_THREAD, **(environment or {})},
        start_new_session=True,  # so that what it starts itself ends with it
    )  # fmt: skip

    def listen() -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                heard.put((script, line))
        process.wait()
        heard.put((script, None))

    Thread(target=listen, daemon=True).start()
    return _Running(process, messages, figures, monotonic(), [])


def _end(process: subprocess.Popen[str]) -> None:
    """Kill it, and what it started, which may outlive it."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError, PermissionError):  # the latter is what macOS says of a group of zombies
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


@contextmanager
def terminable() -> Iterator[None]:
    """Inside, SIGTERM and SIGHUP are a SystemExit, so that what was begun is ended on the way out."""

    def leave(signum: int, frame: Any) -> None:
        raise SystemExit(128 + signum)

    names = [name for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    in_main = threading.current_thread() is threading.main_thread()
    before = {getattr(signal, name): signal.getsignal(getattr(signal, name)) for name in names if in_main}
    changed = [signum for signum, handler in before.items() if handler is signal.SIG_DFL]  # nohup's stays
    for signum in changed:
        signal.signal(signum, leave)
    try:
        yield
    finally:
        for signum in changed:
            signal.signal(signum, before[signum])


def _outcome(
    script: Script, run: _Running, limit: float | None, tell: Callable[[Script, Claim | None], None]
) -> Outcome:
    """Outcome of a process that has ended. A script that stopped on an error, or found nothing, is a failed claim."""
    run.messages.seek(0)
    last = next((line.strip() for line in reversed(run.messages.read().splitlines()) if line.strip()), "no message")
    run.messages.close()
    status, text, reference = run.process.returncode, f"{script.file} runs to its end", ITSELF
    absent = re.match(r"ModuleNotFoundError: No module named '(\w+)", last)
    extra: Claim | None = None
    if limit is not None:
        extra = claim(text, "ended by the runner", f"within {duration(limit)}", False, reference)
    elif status and absent and absent[1] in script.peers:
        extra = not_run(script.shows, "", absent[1], INSTALL)
    elif status:
        extra = claim(text, f"exit status {status}: {last}", "no error", False, reference)
    elif not run.claims:
        extra = claim(text, "no claim", "one or more", False, reference)
    if extra:
        run.claims.append(extra)
        tell(script, extra)
    return Outcome(script, run.claims, monotonic() - run.began, sorted(run.figures.glob("*.png")))


class Display:
    """Failed claims and a line for each script on standard output; on a terminal, a bar that says what runs. The time
    left is an estimate from the scripts' usual times; without a terminal it stands on standard error."""

    def __init__(self, scripts: Sequence[Script], quiet: bool = False) -> None:
        self.total, self.done = len(scripts), 0
        self._begun: Counter[str] = Counter()
        self._seconds, self._whole, self._pace = 0.0, sum(script.seconds for script in scripts), Pace()
        self._pace.moved(0, round(self._whole))
        self._quiet = quiet
        self._bar = None if quiet or not sys.stderr.isatty() else self._new_bar()

    def _new_bar(self) -> Any:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        layout = (BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
        console = Console(stderr=True)
        bar = Progress(*layout, console=console, transient=True, redirect_stdout=sys.stdout.isatty())
        bar.add_task("", total=self.total)
        return bar

    def __enter__(self) -> Display:
        if self._bar:
            self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar:
            self._bar.stop()

    def tell(self, script: Script, row: Claim | None) -> None:
        """A script began (None), or gave a claim."""
        self._begun[script.name] += row is not None
        if row and row["verdict"] == "fail":
            out(f"fail: {script.name}: {row['claim']}: {text_of(row['value'])}, bound {row['bound']}")
            sys.stdout.flush()
        self._move()

    def ended(self, outcome: Outcome) -> None:
        self.done += 1
        self._seconds += outcome.script.seconds
        self._begun.pop(outcome.script.name, None)
        out(
            f"[{self.done}/{self.total}] {outcome.script.name}: {verdicts(outcome.count())} in "
            f"{duration(outcome.seconds)}"
        )
        sys.stdout.flush()
        self._pace.moved(round(self._seconds), round(self._whole))
        if self._bar is None and not self._quiet and self._pace.left:
            print_line(f"validating: {self._left()}")
        self._move()

    def _left(self) -> str:
        """Share of the usual time that is done, and the time left as text."""
        left = f", about {duration(self._pace.left)} left" if self._pace.left else ""
        return f"{100 * self._seconds / max(self._whole, 1e-9):.0f} %{left}"

    def _move(self) -> None:
        if self._bar:
            now = ", ".join(f"{name} ({counted(number, 'claim')})" for name, number in self._begun.items())
            self._bar.update(self._bar.task_ids[0], completed=self.done, description=f"{self._left()}: {now}")


def verdicts(found: Counter[str]) -> str:
    """ "17 pass, 1 fail"."""
    return ", ".join(f"{found[verdict]} {verdict}" for verdict in VERDICTS if found[verdict])


def listed(scripts: Sequence[Script] = SCRIPTS) -> None:
    rows = [[each.name, f"{each.seconds:.0f} s", ", ".join(each.peers), each.shows] for each in scripts]
    print_table(None, ["name", "time", "peers", "shows"], rows)


def validate(
    names: Sequence[str] = (),
    long: bool = False,
    jobs: int = 2,
    report: Path | None = None,
    quiet: bool = False,
    *,
    scripts: Sequence[Script] = SCRIPTS,
    package: str = PACKAGE,
) -> int:
    """Run scripts, show how it goes, write the report; the exit status, 1 where a claim failed."""
    wanted = chosen(names, scripts)
    target = report_file.target(report, whole=not names)
    began, found = monotonic(), list[Outcome]()
    with (
        terminable(),
        tempfile.TemporaryDirectory(prefix="kickdrift-validate-") as scratch,
        Display(wanted, quiet) as display,
    ):
        limit = None if long else LONGEST
        runs = outcomes(wanted, Path(scratch), long, jobs, package=package, limit=limit, tell=display.tell)
        with closing(runs):
            for outcome in runs:
                display.ended(outcome)
                found.append(outcome)
        found.sort(key=lambda outcome: scripts.index(outcome.script))
        report_file.write(target, found, long=long, seconds=monotonic() - began, jobs=jobs)
    total = sum((outcome.count() for outcome in found), Counter[str]())
    out(f"{counted(total.total(), 'claim')}: {verdicts(total)} in {duration(monotonic() - began)}; {target}")
    return int(total["fail"] > 0)
