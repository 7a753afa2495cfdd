"""Progress: rate and time left, lines where there is no terminal, and nothing on standard output."""

from __future__ import annotations

import json
import sys
import threading

import pytest

import kickdrift as kd
from kickdrift.display import pace, showing
from kickdrift.display.pace import LineBar, Pace, busy_line


class Clock:
    """A clock that stands until it is set."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_the_rate_counts_from_the_first_report(clock):
    """Compiling comes before the first report, and members that were done earlier took no time."""
    found = Pace(clock)
    clock.now += 60.0
    found.moved(40, 100)
    assert (found.rate, found.left) == (0.0, 0.0)
    assert found.text(40, 100) == "40 %"
    clock.now += 10.0
    found.moved(60, 100)
    assert (found.rate, found.left) == (2.0, 20.0)
    assert found.text(60, 100) == "60 %, 2/s, 20 s left"


def test_a_run_to_a_time_has_no_rate_in_thousandths(clock):
    found = Pace(clock)
    found.moved(0, 1000)
    clock.now += 10.0
    found.moved(100, 1000)
    assert found.text(100, 1000) == "10 %, 2 min left"


def test_lines_come_ever_rarer_and_on_standard_error(clock, capsys):
    bar = LineBar("running", clock)
    bar(0, 100_000)
    for second in range(1, 100):
        clock.now = 100.0 + second
        bar(second * 1000, 100_000)
    bar(100_000, 100_000)
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert out == ""
    assert [line.split()[1] for line in lines] == ["2", "12", "32", "72"]
    assert lines[1] == "running: 12 %, 1,000/s, 88 s left"


def test_short_work_says_nothing(clock, capsys):
    bar = LineBar("running", clock)
    for done in range(101):
        bar(done, 100)
    with busy_line("drawing"):
        pass
    assert capsys.readouterr() == ("", "")


def test_parts_of_the_work_show_where_progress_is_shown_and_nowhere_else(monkeypatch, capsys):
    monkeypatch.setattr(pace, "SHORT", -1.0)
    showing.stage("reading")(1, 2)
    with showing.last_stage("finishing"):
        pass
    with showing.progress_bar(quiet=True):
        showing.stage("reading")(1, 2)
    assert capsys.readouterr() == ("", "")
    with showing.progress_bar():
        showing.stage("reading")(1, 2)
    showing.stage("reading")(1, 2)
    assert capsys.readouterr() == ("", "reading: 50 %\n")


def test_the_end_of_a_run_says_what_it_does(monkeypatch, capsys, tmp_path):
    """Packing moves a bar that ends at the whole."""
    told: list[tuple[str, int, int]] = []
    token = showing._making.set(lambda label: lambda done, of: told.append((label, done, of)))
    path = tmp_path / "run.h5md"
    try:
        kd.Simulation(kd.load("two-body")).run(50, output=path, file=kd.FileOptions(compress=True))
    finally:
        showing._making.reset(token)
    assert told[0] == ("finishing run.h5md", 0, 0)
    assert told[-1][0] == "finishing run.h5md"
    packed = [done for label, done, of in told if label == "compressing"]
    assert packed == sorted(packed)
    assert 900 <= packed[-1] <= 1000


def test_work_that_counts_nothing_says_what_it_does(capsys, monkeypatch):
    monkeypatch.setattr(pace, "SHORT", 0.01)
    with showing.busy("drawing run.h5md"):
        for timer in [each for each in threading.enumerate() if isinstance(each, threading.Timer)]:
            timer.join(timeout=10)
    assert capsys.readouterr() == ("", "drawing run.h5md …\n")


def test_progress_goes_to_standard_error_and_quiet_says_nothing(monkeypatch, capfd):
    """Standard output holds the JSON object alone, however long the run takes."""
    monkeypatch.setattr(pace, "SHORT", -1.0)
    given = ["kickdrift", "run", "two-body", "--steps", "5000", "--every", "50", "--json", "-"]
    from kickdrift.cli.main import main

    for more, shown in ((["--quiet"], False), ([], True)):
        monkeypatch.setattr(sys, "argv", [*given, *more])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capfd.readouterr()
        assert ended.value.code == 0
        assert json.loads(out)["steps"] == 5000
        assert ("running: " in err) is shown


def test_members_of_an_ensemble_are_counted(capsys, monkeypatch):
    monkeypatch.setattr(pace, "SHORT", -1.0)
    with showing.members_bar() as bar:
        assert bar is not None
        bar(1, 4, 0)
        bar(2, 4, 1)
    assert capsys.readouterr().err.splitlines()[0] == "members: 25 %"
