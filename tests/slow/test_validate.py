"""`kickdrift validate`: what it runs, says and writes, with small scripts in place of the real ones."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift_validation import faults, report_file, runner
from kickdrift_validation.faults import FAULTS
from kickdrift_validation.registry import SCRIPTS, Script
from tests.folders import TOP

VALIDATION = TOP / "validation"
PACKAGE = "some_scripts"  # name of a package with the texts below as modules
GOOD = """
from kickdrift_validation.claim import claim, not_run
def claims(long=False, figures=None):
    print("a table of its own")
    yield claim("a | b", 1.0, "at most 1", True, "x < y")
    if long:
        yield claim("only in the long set", 2, "2", True, "y")
    (figures / "good.png").write_bytes(b"png")
"""
BAD = """
import numpy as np
from kickdrift_validation.claim import claim
def claims(long=False):
    return [claim("a number of NumPy", np.float64(3.0), "under 2", np.bool_(False), "y")]
"""
CRASH = """
from kickdrift_validation.claim import claim
def claims(long=False):
    yield claim("first", 0, "0", True, "y")
    raise ValueError("no such thing")
"""
ABSENT = "import peer_that_nobody_has\n"
HANGS = """
import time
def claims(long=False):
    time.sleep(600)
    yield
"""
LEAVES = """
import os, time
from pathlib import Path
def claims(long=False):
    if not os.fork():  # with the pipe open
        Path("left.txt").write_text(str(os.getpid()))
        time.sleep(600)
    while not Path("left.txt").is_file():
        time.sleep(0.01)
    raise ValueError("and a child lives on")
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Working folder beside a package of scripts."""
    path = [str(tmp_path / "path"), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path))
    place = tmp_path / "path" / PACKAGE
    place.mkdir(parents=True)
    texts = {
        "good": GOOD,
        "bad": BAD,
        "crash": CRASH,
        "absent_peer": ABSENT,
        "hangs": HANGS,
        "leaves": LEAVES,
        "none": "claims = list\n",
    }
    for name, text in texts.items():
        (place / f"{name}.py").write_text(text, encoding="utf-8")
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    return work


def scripts(*names: str) -> list[Script]:
    peers = {"absent-peer": ("peer_that_nobody_has",)}
    return [Script(f"{name.replace('-', '_')}.py", f"what {name} shows", 1.0, peers.get(name, ())) for name in names]


def validated(folder, *names, **options) -> tuple[int, str]:
    """Exit status and report."""
    report = folder / "report" / "REPORT.md"
    status = runner.validate(scripts=scripts(*names), package=PACKAGE, report=report, quiet=True, **options)
    return status, report.read_text(encoding="utf-8")


def test_what_passes_is_exit_status_zero_and_a_report(folder, capfd):
    status, report = validated(folder, "good", "absent-peer")
    assert status == 0
    assert "**2 claims: 1 pass, 0 fail, 1 not run.**" in report
    assert "| a \\| b | 1 | at most 1 | x &lt; y | pass |" in report
    assert "only in the long set" not in report
    assert "![good](figures/good.png)" in report
    assert (folder / "report" / "figures" / "good.png").read_bytes() == b"png"
    assert "pip install" in report
    assert f"| kickdrift | {kd.__version__} |" in report
    for name in ("numba", "numpy", "scipy", "h5py", "rebound"):
        assert f"| {name} |" in report
    printed = capfd.readouterr().out
    assert "2 claims: 1 pass, 1 not run" in printed
    assert "a table of its own" not in printed


def test_the_long_set(folder):
    status, report = validated(folder, "good", long=True)
    assert status == 0
    assert "only in the long set" in report
    assert "| set | long |" in report


def test_a_claim_that_fails_is_exit_status_one(folder, capfd):
    status, report = validated(folder, "good", "bad")
    assert status == 1
    assert "| a number of NumPy | 3 | under 2 | y | **fail** |" in report
    assert "fail: bad: a number of NumPy: 3, bound under 2" in capfd.readouterr().out


def test_a_script_that_stops_is_a_claim_that_fails(folder):
    status, report = validated(folder, "crash", "none")
    assert status == 1
    assert "| first | 0 | 0 | y | pass |" in report
    assert "crash.py runs to its end | exit status 1: ValueError: no such thing | no error" in report
    assert "none.py runs to its end" in report


def test_a_peer_that_is_no_peer_of_the_script_is_a_failure(folder):
    (outcome,) = runner.outcomes([Script("absent_peer.py", "x")], folder / "scratch", package=PACKAGE)
    assert outcome.claims[0]["verdict"] == "fail"


def test_what_takes_too_long_is_ended(folder):
    began = time.monotonic()
    (outcome,) = runner.outcomes(scripts("hangs"), folder / "scratch", package=PACKAGE, limit=3.0)
    assert time.monotonic() - began < 60
    assert outcome.claims[0]["verdict"] == "fail"
    assert outcome.claims[0]["bound"] == "within 3 s"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_what_a_script_leaves_behind_ends_with_it(folder):
    (outcome,) = runner.outcomes(scripts("leaves"), folder / "scratch", package=PACKAGE)
    assert "and a child lives on" in str(outcome.claims[0]["value"])
    left = Path(f"/proc/{(folder / 'left.txt').read_text()}/stat")
    for _ in range(100):  # init needs time to remove the process
        if not left.exists() or left.read_text().rpartition(")")[2].split()[0] == "Z":
            return
        time.sleep(0.05)
    raise AssertionError("the child lives on")


def test_untested_versions_are_noted(folder, monkeypatch):
    from kickdrift.engines import ENGINES, Engine

    assert "**Note:**" not in validated(folder, "good")[1]
    other = {"rebound": Engine("rebound", "", ("numpy",), ("0",)), "openmm": Engine("openmm", "", ("scipy",), ("0",))}
    monkeypatch.setattr(report_file, "ENGINES", {**ENGINES, **other})
    monkeypatch.setattr(report_file, "_peers", lambda: ["numpy"])
    report = validated(folder, "good")[1]
    assert f"**Note:** numpy {np.__version__} is not a tested version: 0.x.\n" in report


def test_figures_of_the_report_before_go_and_no_others(folder):
    validated(folder, "good")
    figures = folder / "report" / "figures"
    (figures / "mine.png").write_bytes(b"mine")
    report = validated(folder, "bad")[1]
    assert "figures/" not in report
    assert [path.name for path in figures.iterdir()] == ["mine.png"]


def test_a_report_takes_the_place_of_a_report_and_of_nothing_else(folder):
    status, _ = validated(folder, "good")
    assert status == 0
    assert validated(folder, "bad")[0] == 1
    report = folder / "report" / "REPORT.md"
    report.write_text("my own notes\n", encoding="utf-8")
    with pytest.raises(InputError, match="is not replaced"):
        validated(folder, "good")
    assert report.read_text(encoding="utf-8") == "my own notes\n"
    report.unlink()
    (report.parent / "figures" / "mine.png").write_bytes(b"mine")
    with pytest.raises(InputError, match="figures beside it are of no report"):
        validated(folder, "good")


def test_where_the_report_goes(folder):
    assert report_file.target(None, whole=True) == VALIDATION / "REPORT.md"
    assert report_file.target(None, whole=False) == Path("validation-report") / "REPORT.md"
    (folder / "file").write_text("")
    with pytest.raises(InputError, match=r"--report file/REPORT\.md"):
        report_file.target(Path("file/REPORT.md"), whole=True)


def test_names():
    assert [s.name for s in runner.chosen(["nist_lj.py", "kickdrift_validation.nve_drift"])] == ["nist-lj", "nve-drift"]
    assert {s.name for s in runner.chosen([])} == {s.name for s in SCRIPTS}
    with pytest.raises(InputError, match="did you mean nist-lj"):
        runner.chosen(["nist-jl"])


def test_an_unknown_name_is_exit_status_two(tmp_path):
    words = [sys.executable, "-m", "kickdrift_validation"]
    done = subprocess.run([*words, "nist-jl"], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 2
    assert "did you mean nist-lj" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize(("sent", "status"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_interrupted_it_ends_its_children(folder, sent, status):
    program = (
        "import signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a background job starts without these handlers
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"
        "from pathlib import Path\nfrom kickdrift_validation import runner\n"
        "from kickdrift_validation.registry import Script\n"
        "rows = [Script('hangs.py', 'x')]\n"
        "try:\n    runner.validate(scripts=rows, package=sys.argv[1], report=Path('r/REPORT.md'), quiet=True)\n"
        "except KeyboardInterrupt:\n    sys.exit(130)\n"
    )
    words = [sys.executable, "-c", program, PACKAGE]
    with subprocess.Popen(words, cwd=folder, start_new_session=True) as process:
        child = None
        for _ in range(600):
            time.sleep(0.1)
            found = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            child = found.read_text().split() if found.exists() else None
            if child:
                break
        assert child
        time.sleep(1.0)
        os.kill(process.pid, getattr(signal, sent))
        try:
            assert process.wait(timeout=60) == status
        finally:
            process.kill()
    assert not Path(f"/proc/{child[0]}").exists()
    assert not (folder / "r" / "REPORT.md").exists()


# --- faults ---


def test_a_fault_is_planted_in_a_copy_and_nowhere_else(tmp_path):
    package = Path(kd.__file__).parent
    before = {path: path.read_bytes() for path in package.rglob("*.py")}
    path = faults.copied(tmp_path, FAULTS[0]).split(os.pathsep)
    assert path[:2] == [str(tmp_path / "src"), str(tmp_path / "validation")]
    assert (tmp_path / "validation" / "kickdrift_validation" / "nist_lj.py").is_file()
    there = tmp_path / "src" / "kickdrift"
    differ = [path for path, text in before.items() if (there / path.relative_to(package)).read_bytes() != text]
    assert [path.relative_to(package).as_posix() for path in differ] == [FAULTS[0].file]
    assert FAULTS[0].wrong in (there / FAULTS[0].file).read_text(encoding="utf-8")
    assert {path: path.read_bytes() for path in package.rglob("*.py")} == before
    assert (tmp_path / "systems" / "lj-1000.toml").is_file()


def test_the_order_has_every_short_script_once():
    names = [script.name for script in faults.in_order()]
    assert names[: len(faults.FIRST)] == list(faults.FIRST)
    assert sorted(names) == sorted(script.name for script in SCRIPTS)


def test_the_first_claim_that_fails_ends_the_search(folder, monkeypatch):
    from threading import Event

    monkeypatch.setattr(faults, "copied", lambda place, fault: os.environ["PYTHONPATH"])
    found = faults.tried(None, scripts("good", "bad", "hangs"), Event(), package=PACKAGE)
    assert (found.script, found.passed) == ("bad", 1)
    assert found.claim is not None
    assert "caught" in faults.line("x", "y", found)
    assert "the runner" not in faults.line("x", "y", found)
    found = faults.tried(None, scripts("hangs"), Event(), limit=2.0, package=PACKAGE)
    assert (found.script, found.passed) == ("hangs", 0)
    assert "by the runner, no measurement: hangs: " in faults.line("x", "y", found)
    found = faults.tried(None, scripts("good"), Event(), package=PACKAGE)
    assert found.claim is None
    assert "no claim of 1 failed" in faults.line("x", "y", found)


def test_the_report_in_the_repository_is_of_a_whole_run():
    """If this fails, run: kickdrift validate"""
    text = (VALIDATION / "REPORT.md").read_text(encoding="utf-8")
    assert re.search(r"^\*\*\d+ claims: \d+ pass, 0 fail, 0 not run\.\*\*$", text, flags=re.MULTILINE)
    assert all(f"## {row.name}\n" in text for row in SCRIPTS)
    for figure in re.findall(r"\(figures/(\S+\.png)\)", text):
        assert (VALIDATION / "figures" / figure).is_file()
