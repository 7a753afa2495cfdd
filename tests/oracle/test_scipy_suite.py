"""SciPy's own tests of solve_ivp, run on ``kickdrift.solve`` in the place of ``solve_ivp``."""

import importlib.util
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from tests.folders import TOP

SUITE = "scipy.integrate._ivp.tests.test_ivp"
PLUGIN = ("-p", "no:cacheprovider", "-p", "tests.oracle.scipy_plugin")
RUN = ("-m", "pytest", "-c", os.devnull, *PLUGIN, "--junitxml", "results.xml", "--pyargs", SUITE)
# The tests that do not pass, and why.
EXCEPTIONS = {"test_t_eval_early_event": "wants t and y as lists where no time is asked for; ours are empty arrays"}
# The tests that say nothing about us: they never call solve_ivp.
SCIPYS_OWN = {
    "test_ConstantDenseOutput": "a class of SciPy's",
    "test_OdeSolution": "a class of SciPy's",
    "test_classes": "makes and steps SciPy's solvers itself",
    "test_no_integration_class": "makes and steps SciPy's solvers itself",
    "test_inital_maxstep": "SciPy's function for the first step",
    "test_num_jac": "SciPy's Jacobian by differences",
    "test_num_jac_sparse": "SciPy's Jacobian by differences",
}
METHODS = ("bogacki-shampine23", "dormand-prince45", "dop853", "radau", "bdf", "lsoda")


def suite_is_there():
    try:
        return importlib.util.find_spec(SUITE) is not None
    except ModuleNotFoundError:
        return False


@pytest.mark.long
@pytest.mark.skipif(not suite_is_there(), reason="the installed SciPy comes without its tests")
def test_scipys_own_tests_pass_on_solve(tmp_path):
    paths = [str(TOP), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, *RUN],
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
    called = re.search(r"tests that call solve: (.*)", done.stdout)
    assert called
    assert results.keys() - set(called[1].split()) <= SCIPYS_OWN.keys()
    for method in METHODS:
        taken = re.search(rf"{method} took (\d+) steps", done.stdout)
        assert taken
        assert int(taken[1]) > 100
