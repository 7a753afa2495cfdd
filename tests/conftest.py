"""Set-up of the tests: registers the methods of the docs' page, so that the contract tests run on them too."""

from __future__ import annotations

import compileall
import gc
import os
import signal
import sys

import pytest
from hypothesis import settings

from tests import own_methods
from tests.compiled import without_compiling
from tests.folders import TOP

# Before NumPy is loaded: two test processes whose BLAS threads wait for each other are many times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if sys.dont_write_bytecode:  # child processes would compile the package from source, a third of the start of each
    compileall.compile_dir(TOP / "src", quiet=2)
# numba colours each of the many errors that it meets while it tries functions, a tenth of the compilation time.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

settings.register_profile("kickdrift", deadline=None)  # the first case of a test may compile
settings.load_profile("kickdrift")

# Scanning numba's many lasting objects for garbage took an eighth of the time at Python's own thresholds.
gc.set_threshold(50_000, 20, 20)

own_methods.register()  # before tests are collected, so that the contract tests run on these methods too

# The longest files, which run first, so that no process waits for another at the end. The first file compiles every
# loop. Meanwhile the next four and their child processes compile other code. Later files find all this code on disk.
LONGEST = (
    "test_same_bits", "test_cuda", "test_wisdom_holman", "test_pair_forces", "test_charges", "test_compile_cache",
    "test_pressure", "test_trace_derivatives", "test_engines", "test_cli", "test_bridges_openmm",
    "test_bridges_lammps", "test_batch", "test_compare", "test_solve", "test_implicit", "test_virtual_sites",
    "test_terminal", "test_robustness", "test_problem", "test_chaos", "test_field_laws", "test_resume", "test_export",
    "test_exact", "test_mesh", "test_systems", "test_damage", "test_integrators", "test_forces", "test_events",
    "test_ensemble", "test_docs", "test_readme", "test_validation",
)  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background job ignores Ctrl-C, which tests press
        signal.signal(signal.SIGINT, signal.default_int_handler)
    absent = {*LONGEST} - {path.stem for path in (TOP / "tests").rglob("test_*.py")}
    if absent:
        raise pytest.UsageError(f"tests/conftest.py: LONGEST names files that are not there: {absent}")
    if hasattr(config.option, "loadscopereorder"):  # with xdist, which would order files by their number of tests
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    order = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(order)))


@pytest.fixture
def kickdrift(monkeypatch, capfd):
    """The program in this process: ``kickdrift("run", "x.toml")`` returns exit status, standard output and error.

    Lines about what was compiled are left out."""

    def call(*arguments) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["kickdrift", *map(str, arguments)])
        capfd.readouterr()
        from kickdrift.cli.main import main

        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capfd.readouterr()
        return ended.value.code, out, without_compiling(err)

    return call
