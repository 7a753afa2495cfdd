"""SciPy's own tests of solve_ivp, run on our adaptive methods in place of RK23, RK45 and DOP853."""

import importlib.util
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from tests.folders import TOP

SUITE = "scipy.integrate._ivp.tests.test_ivp"
RUN = ("--junitxml", "results.xml", "--pyargs", SUITE)
# Tests that do not pass, with the reason.
EXCEPTIONS: dict[str, str] = {}


def suite_is_there():
    try:
        return importlib.util.find_spec(SUITE) is not None
    except ModuleNotFoundError:
        return False


@pytest.mark.skipif(not suite_is_there(), reason="the installed SciPy comes without its tests")
def test_scipys_own_tests_pass_on_our_methods(tmp_path):
    paths = [str(TOP), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-c",
            os.devnull,
            "-p",
            "no:cacheprovider",
            "-p",
            "tests.oracle.scipy_adapter",
            *RUN,
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
    )
    assert (tmp_path / "results.xml").exists(), done.stdout + done.stderr
    results = {
        case.attrib["name"]: {child.tag for child in case}
        for case in ElementTree.parse(tmp_path / "results.xml").iter("testcase")
    }
    assert len(results) >= 40
    failed = {name for name, tags in results.items() if tags & {"failure", "error"}}
    assert failed == set(EXCEPTIONS), done.stdout[-5000:]
    assert not {name for name, tags in results.items() if "skipped" in tags}
    for method in ("bogacki-shampine23", "dormand-prince45", "dop853"):
        taken = re.search(rf"{method} took (\d+) steps", done.stdout)
        assert taken
        assert int(taken[1]) > 100
