"""Cache of compiled code: an edited force is recompiled, an unchanged one compiles once, a deleted one does no harm."""

from __future__ import annotations

import shutil
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.pairs.law import pair_law
from kickdrift.jit.cache.described import Sources
from kickdrift.jit.cache.folders import folder
from kickdrift.model.system import System

MEASURE = """
import sys
from pathlib import Path
import kickdrift.jit.cache.cache as code_cache
code_cache.folder = lambda: Path(sys.argv[1])
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.system import System

def measure(force, threads=1):
    system = System([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], forces=[force])
    measured = BoundForces(system, threads).measure(0.0, system.state.phase)
    print(measured.potential, measured.accelerations[2, 1])
"""
LAW = """
from typing import NamedTuple
from kickdrift.forces.pairs.law import pair_law

@pair_law
class Quartic(NamedTuple):
    k: float
    def law(p, r2):
        return 0.5 * p.k * r2 * r2, -2.0 * p.k * r2
"""
KERNEL = """
from typing import NamedTuple
import numpy as np
from kickdrift.forces.seam.kernel import kernel

class Trap(NamedTuple):
    stiffness: float
    centre: np.ndarray
    def check(self, system): ...
    def bind(self, system, threads=1): return self

@kernel(Trap)
def trap(force, t, x, v, a, sums):
    for k in range(3):
        for i in range(x.shape[1]):
            a[k, i] -= force.stiffness * (x[k, i] - force.centre[k])
    return 0
"""


class Workshop:
    """A folder of a user's files, with its own cache."""

    def __init__(self, path):
        self.path, self.cache = path, path / "cache"

    def take_the_packages_own(self):
        """Copy the package's own code from other tests' cache, if any. The pair list, above all, takes three times as
        long to compile as a law."""
        jit = folder() / "jit"
        for pattern in ("forces.list_code.*.nbc", "forces.evaluate.measure.*.nbc"):
            for path in jit.rglob(pattern):
                copy = self.cache / "jit" / path.relative_to(jit)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, copy)

    def write(self, name, *parts):
        (self.path / name).write_text("\n".join(parts))

    def run(self, script="script.py"):
        """Output of the script, and the number of new compiled functions."""
        before = self.compiled()
        command = [sys.executable, "-B", script, str(self.cache)]
        done = subprocess.run(command, cwd=self.path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr[-3000:]
        return [float(word) for word in done.stdout.split()], len(self.compiled() - before)

    def compiled(self):
        return {*self.cache.rglob("*.nbc")}


@pytest.fixture
def workshop(tmp_path):
    return Workshop(tmp_path)


@pytest.mark.long
def test_a_law_in_a_script(workshop):
    call = "measure(Quartic(k=3.0, cutoff=2.0, truncation='cut'))"
    workshop.write("script.py", MEASURE, LAW, call)
    assert workshop.run() == ([1.5, -6.0], 3)  # the package's own function and its list, and the law's function
    assert workshop.run() == ([1.5, -6.0], 0)
    workshop.write("script.py", MEASURE, LAW, call.replace("3.0", "5.0"))  # a number is no edit of the law
    assert workshop.run() == ([2.5, -10.0], 0)
    workshop.write("script.py", MEASURE, LAW.replace("0.5 *", "12.0 + 0.5 *"), call)
    assert workshop.run() == ([13.5, -6.0], 1)
    workshop.write("script.py", MEASURE, LAW, call)
    assert workshop.run() == ([1.5, -6.0], 0)


@pytest.mark.long
def test_laws_that_different_processes_compiled(workshop, monkeypatch):
    """Each process numbers its functions anew, so two laws may have equal names. Both are then used in one process."""
    monkeypatch.setenv("PYTHONHASHSEED", "0")  # names also contain the order of numba's flags
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    workshop.take_the_packages_own()
    call = "measure(Quartic(k=3.0, cutoff=2.0, truncation={0!r}), threads=2)"
    shift, cut = call.format("shift"), call.format("cut")
    for each in (shift, cut):
        workshop.write("script.py", MEASURE, LAW, each)
        workshop.run()
    workshop.write("script.py", MEASURE, LAW, shift, cut)
    assert workshop.run() == ([1.5 - 24.0, -6.0, 1.5, -6.0], 0)


@pytest.mark.long
def test_laws_of_one_name(workshop, monkeypatch):
    """Two modules have a class of the same name. Each law keeps its own code, although different processes compiled
    them."""
    monkeypatch.setenv("PYTHONHASHSEED", "0")
    workshop.take_the_packages_own()
    call = "import {0}\nmeasure({0}.Quartic(k=3.0, cutoff=2.0, truncation='cut'))"
    one, two = call.format("one"), call.format("two")
    workshop.write("one.py", LAW)
    workshop.write("two.py", LAW.replace("0.5 *", "1.5 *").replace("-2.0 *", "-6.0 *"))
    for each in (one, two):
        workshop.write("script.py", MEASURE, each)
        workshop.run()
    workshop.write("script.py", MEASURE, one, two)
    assert workshop.run() == ([1.5, -6.0, 4.5, -18.0], 0)


@pytest.mark.long
def test_a_kernel_in_a_module(workshop):
    call = "import numpy as np\nfrom {0} import Trap\nmeasure(Trap(2.0, np.zeros(3)))"
    workshop.write("mine.py", KERNEL)
    workshop.write("script.py", MEASURE, call.format("mine"))
    assert workshop.run() == ([0.0, -2.0], 2)  # the package's own function, and the kernel
    assert workshop.run() == ([0.0, -2.0], 0)
    workshop.write("mine.py", KERNEL.replace("force.stiffness *", "3.0 * force.stiffness *"))
    assert workshop.run() == ([0.0, -6.0], 1)
    workshop.write("params.py", "SCALE = 5.0")
    workshop.write("mine.py", "import params", KERNEL.replace("force.stiffness *", "params.SCALE * force.stiffness *"))
    assert workshop.run() == ([0.0, -10.0], 1)
    workshop.write("params.py", "SCALE = 7.0")
    assert workshop.run() == ([0.0, -14.0], 1)
    # the kernel is also saved under another name, and must work after its first module is gone
    workshop.write("copy_of_mine.py", KERNEL)
    (workshop.path / "mine.py").unlink()
    workshop.write("script.py", MEASURE, call.format("copy_of_mine"))
    assert workshop.run()[0] == [0.0, -2.0]


def test_a_kernel_of_numbers_alone(workshop):
    kernel = KERNEL.replace("    centre: np.ndarray\n", "").replace(" - force.centre[k]", "")
    workshop.write("script.py", MEASURE, kernel, "measure(Trap(2.0))")
    assert workshop.run() == ([0.0, -2.0], 2)  # the package's own function, and the kernel


@pair_law
class Law(NamedTuple):
    a: float

    def law(p, r2):
        return p.a * r2, -2.0 * p.a


def test_users_laws_are_foreign():
    for species in (["A", "A"], ["A", "B"]):
        force = Law(a=1.0, cutoff=2.0, species={each: {} for each in species}, pairs={tuple(species): {"a": 2.0}})
        system = System(np.eye(3)[:2], forces=[force], species=species)
        sources = Sources()
        sources.add_type(typeof(BoundForces(system).forces[0].parts))
        assert sources.foreign
        assert sources.cover([Law.Parameters.law])
        assert not sources.cover([test_users_laws_are_foreign])
