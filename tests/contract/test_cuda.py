"""The engine cuda: on a simulated device, and what it says where there is none.

A device is simulated only where numba is told before it is loaded. So one test runs the others, and those of
test_engines.py, in a process of its own.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import subprocess
import sys
import threading
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit

import kickdrift as kd
from kickdrift.analysis.certify.force_tests import Evaluator
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from tests.folders import TOP
from tests.long import rest
from tests.oracle.forces import gravity_accelerations, pair_oracle
from tests.simulated import SIMULATED, WITHOUT_DEVICE

MD = {"integrator": "velocity-verlet", "dt": 0.002}
STEEP = 6.0
PAIRS = {
    "lennard-jones": {("A", "B"): {"sigma": 0.9, "epsilon": 1.5}, ("B", "B"): {"sigma": 0.8}},
    "device-morse": {("A", "B"): {"length": 1.0, "depth": 1.5}, ("B", "B"): {"depth": 0.5}},
}


@njit
def rise(r, length):
    return math.exp(-STEEP * (r - length))


@kd.pair_law
class DeviceMorse(NamedTuple):
    """A law with a helper and a constant outside its body."""

    depth: float = 1.0
    length: float = 1.1

    def law(p, r2):
        r = math.sqrt(r2)
        e = rise(r, p.length)
        return p.depth * (e * e - 2.0 * e), 2.0 * p.depth * STEEP * (e * e - e) / r


def liquid(**arguments) -> kd.System:
    positions, edges = lattice("sc", 27, 0.8442)
    positions += np.random.default_rng(1).uniform(-0.08, 0.08, positions.shape) + np.array(edges) * [0, 3, -1]
    arguments = {"box": edges, "forces": [kd.LennardJones(cutoff=1.4)], **arguments}
    return kd.System(positions, maxwell_boltzmann(np.ones(27), 1.5, 1.0, 1), **arguments)


def stars(softening: float = 0.0) -> kd.System:
    rng = np.random.default_rng(2)
    masses = rng.uniform(0.5, 1.5, 40) * (np.arange(40) % 4 > 0)
    force = kd.Gravity(G=1.0, softening=softening)
    return kd.System(rng.normal(size=(40, 3)), 0.3 * rng.normal(size=(40, 3)), masses, forces=[force], units="nbody")


def session_of(sim: kd.Simulation):
    """The running session."""
    sim.sample()
    return sim.integration.stepper._session


def python_sums(system: kd.System) -> np.ndarray:
    """Forces (n, 3) of a law that its Python function gives, with truncation "shift"."""
    x, force = system.state.positions, system.forces[0]
    d = system.box.minimum_image(x[:, None] - x[None])
    r2, kinds = (d**2).sum(axis=2), [system.species[k] for k in system.species_index]
    found = np.zeros_like(x)
    for i, j in np.argwhere((r2 < force.cutoff**2) & (r2 > 0)).tolist():
        found[i] += force.pair_law(kinds[i], kinds[j]).law(r2[i, j])[1] * d[i, j]
    return found


def step_forces(sim: kd.Simulation) -> np.ndarray:
    """Accelerations (3, n) of steps; in mixed precision, samples have others."""
    session = session_of(sim)
    session.forces.evaluate(session.particles)
    return session.particles.in_order(session.particles.a)


# The simulator takes minutes for what a device does at once: these cases run with the long tests.
SIMULATED_LONG = (
    "(plane and not line) or open or cuda-43 or cuda-44 or cuda-45 or cuda-46 or cuda-47 or andersen or csvr or hoover"
)
ALL_OF_CUDA = "cuda and not on_a_simulated_device and not load_the_engine"


@pytest.mark.parametrize(
    "chosen",
    [f"{ALL_OF_CUDA} and not ({SIMULATED_LONG} or 4-mixed or (restarts and mixed))", rest(ALL_OF_CUDA)],
    ids=["of each kind", "all"],
)
def test_on_a_simulated_device(chosen):
    command = [sys.executable, "-m", "pytest", "-p", "tests.simulated", "-k", chosen]
    files = [f"tests/contract/{name}.py" for name in ("test_cuda", "test_engines", "test_engines_in_a_plane")]
    if SIMULATED:
        pytest.skip("this is the simulated device")
    found = subprocess.run(
        [*command, *files], cwd=TOP, env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}, capture_output=True, text=True
    )
    assert found.returncode == 0, found.stdout[-5000:]
    assert " passed" in found.stdout


@WITHOUT_DEVICE
@pytest.mark.parametrize("species", ["A", "ABB"])
@pytest.mark.parametrize("force", [kd.LennardJones(cutoff=1.4, truncation="force-shift"), DeviceMorse(cutoff=1.5)])
def test_mixed_forces(force, species):
    if len(species) > 1:
        force = dataclasses.replace(force, species={"A": {}, "B": {}}, pairs=PAIRS[force.name])
    system = liquid(forces=[force], masses=np.linspace(1.0, 3.0, 27), species=list(species * 27)[:27])
    found = step_forces(kd.Simulation(system, engine="cuda", precision="mixed", **MD))
    pulls = pair_oracle(system)[0] if isinstance(force, kd.LennardJones) else python_sums(system)
    expected = pulls.T / system.state.masses
    assert np.abs(found - expected).max() < 3e-6 * np.abs(expected).max()
    assert np.abs(found @ system.state.masses).max() < 1e-12 * np.abs(expected).max()  # each pair's sum is zero


@WITHOUT_DEVICE
@pytest.mark.parametrize("softening", [0.0, 0.1])
@pytest.mark.parametrize(("precision", "bound"), [("double", 1e-13), ("mixed", 1e-6)])
def test_gravity(precision, bound, softening):
    system = stars(softening)
    found = step_forces(kd.Simulation(system, engine="cuda", precision=precision, integrator="yoshida4", dt=1e-3))
    expected = gravity_accelerations(system).T
    assert np.abs(found - expected).max() < bound * np.abs(expected).max()


@WITHOUT_DEVICE
def test_float32_laws_have_no_float64_in_them():
    from kickdrift.engines.cuda.law_code import truncated_law

    for truncation in ("cut", "shift", "force-shift", "switch"):
        for kind in (kd.LennardJones, DeviceMorse):
            force = kind(cutoff=2.5, truncation=truncation)
            exact, single = (truncated_law(force, ["A"], which) for which in (False, True))
            for r2 in (1.1, 4.5, 6.2):
                found = single[0](np.float32(r2), single[1], 0)
                np.testing.assert_allclose(found, exact[0](r2, exact[1], 0), rtol=2e-5, atol=1e-6)
                if isinstance(force, kd.LennardJones) and truncation in ("cut", "shift"):
                    assert {type(value) for value in found} == {np.float32}


@WITHOUT_DEVICE
@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_bits_do_not_depend_on_cuts_looks_lists_or_restarts(precision, tmp_path):
    path = tmp_path / "run.h5md"
    whole, cut, hasty = (kd.Simulation(liquid(), engine="cuda", precision=precision, **MD) for _ in range(3))
    whole.run(9, every=9)
    cut.run(3, output=path)
    cut.run(3, every=1)
    cut = kd.resume(path)
    cut.run(9 - cut.steps_done)
    session = session_of(hasty)
    session.forces.half_skin = 0.012  # the first block then is taken back
    session.advance(9, math.inf)
    assert session.returns > 0
    for phase in (cut.state.phase, session.phase()):
        assert phase.tobytes() == whole.state.phase.tobytes()


@WITHOUT_DEVICE
@pytest.mark.parametrize(
    ("name", "bath"),
    [
        ("baoab", {"friction": 20.0, "seed": 5}), ("andersen", {"collision_rate": 20.0, "seed": 5}),
        ("csvr", {"tau": 0.02, "seed": 5}),
        ("nose-hoover", {"tau": 0.02}),
    ],
)  # fmt: skip
def test_a_bath_on_cuda_is_the_processors(name, bath, tmp_path):
    path = tmp_path / "run.h5md"
    options = {"temperature": 0.3, **bath}
    ours, theirs, cut, hasty = (
        kd.Simulation(liquid(), name, 0.002, engine=engine, **options) for engine in ("native", *3 * ("cuda",))
    )
    report, other = (sim.run(6, every=6) for sim in (ours, theirs))
    assert np.abs(theirs.state.phase - ours.state.phase).max() < 1e-13
    assert other.heat == pytest.approx(report.heat, rel=1e-12)
    assert abs(report.heat) > 1.0
    cut.run(2, output=path)
    if name != "nose-hoover":  # a resumed run begins with a chain at rest
        cut = kd.resume(path)
    cut.run(4)
    assert cut.state.phase.tobytes() == theirs.state.phase.tobytes()
    session = session_of(hasty)
    session.forces.half_skin = 0.012  # the first block then is taken back
    session.advance(6, math.inf)
    assert session.returns > 0
    assert session.phase().tobytes() == theirs.state.phase.tobytes()
    assert session.heat == other.heat


@WITHOUT_DEVICE
def test_the_script_for_a_device_writes_its_sections_and_their_errors(monkeypatch, tmp_path):
    from kickdrift_validation.performance import device

    monkeypatch.setattr(device, "BODIES", (30,))
    device.main(str(tmp_path / "found.json"), "gravity_forces", "environment")
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["gravity_forces"]["double"]["rms_over_rms"] < 1e-14
    assert found["gravity_forces"]["mixed"]["rms_over_rms"] < 1e-6
    assert "error" in found["environment"]  # the simulator has no name


@WITHOUT_DEVICE
def test_lists_of_many_cells_and_of_few():
    from kickdrift.engines.cuda.forces import PairForces
    from kickdrift.engines.cuda.launches import Launches

    rng = np.random.default_rng(3)
    for edges, periodic in (((4.0, 5.5, 7.0), True), ((9.0, 3.0, 6.5), (True, False, True)), (None, False)):
        box = None if edges is None else kd.Box(edges, periodic=periodic)
        x = rng.uniform(-3.0, 9.0, (60, 3))
        system = kd.System(x, box=box, forces=[DeviceMorse(cutoff=1.2)])
        forces = PairForces(system, Launches(), False, skin=0.24)
        particles = forces.upload(system.state.phase)
        ids, rows, counts = (each.copy_to_host() for each in (particles.ids, forces._near, forces.found))
        found = {(ids[i], ids[j]) for i in range(60) for j in rows[i, : counts[i]]}
        apart = np.linalg.norm(system.box.minimum_image(x[:, None] - x[None]), axis=2)
        assert found == {(i, j) for i, j in np.argwhere(apart < 1.2 * 1.24).tolist() if i != j}
        assert counts.sum() == len(found)


class Warp:
    """Votes and words of the 32 threads of a simulated block, which on a device are a warp."""

    def __init__(self) -> None:
        self.said: list[Any] = [0] * 32

    def all_said(self, number: Any) -> list[Any]:
        thread = threading.current_thread()
        self.said[thread.threadIdx.x] = number
        thread.syncthreads()
        said = list(self.said)
        thread.syncthreads()
        return said

    def votes(self, hit):
        return np.uint32(sum(int(bool(each)) << k for k, each in enumerate(self.all_said(hit))))

    def told(self, number, thread):
        return self.all_said(number)[int(thread)]

    def least(self, number):
        return min(self.all_said(number))

    def together(self) -> None:
        self.all_said(None)

    def across_of(self, lanes):
        def across(number):
            first = threading.current_thread().threadIdx.x // lanes * lanes
            return sum(self.all_said(number)[first : first + lanes])

        return across


@pytest.fixture
def warps(monkeypatch):
    """Kernels for warps of 32 threads, which in the simulator have one otherwise."""
    from kickdrift.engines.cuda import pair_sum, search

    warp = Warp()
    cached = search.group_of, search.sifting_of, search.search_of, pair_sum.forces_of, pair_sum.measure_of
    for module in (search, pair_sum):
        monkeypatch.setattr(module, "WARP", 32)
    for module, names in ((search, ("votes", "told", "least", "together")), (pair_sum, ("across_of",))):
        for name in names:
            monkeypatch.setattr(module, name, getattr(warp, name))
    for kernels in cached:
        kernels.cache_clear()
    yield
    for kernels in cached:
        kernels.cache_clear()


@WITHOUT_DEVICE
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of NumPy: whole numbers wrap
@pytest.mark.parametrize(("lanes", "precision"), [(1, "double"), (4, "mixed")])
def test_the_threads_of_a_warp_share_lists_on_cuda(lanes, precision, warps):
    from kickdrift.engines.cuda.forces import PairForces
    from kickdrift.engines.cuda.launches import Launches

    rng = np.random.default_rng(4)
    x = np.array(list(np.ndindex(4, 3, 5))) + rng.uniform(-0.1, 0.1, (60, 3))
    for box in (kd.Box((4.0, 3.0, 5.0)), kd.Box((9.0, 8.0, 14.0))):
        system = kd.System(x, box=box, forces=[DeviceMorse(cutoff=1.2)])
        forces = PairForces(system, Launches(), precision == "mixed", lanes=lanes)
        particles = forces.upload(system.state.phase)
        forces.evaluate(particles)
        expected = python_sums(system).T
        bound = 1e-12 if precision == "double" else 3e-6
        assert np.abs(particles.in_order(particles.a) - expected).max() < bound * np.abs(expected).max()
        assert np.abs(forces.measure(particles)[0] - expected).max() < 1e-12 * np.abs(expected).max()


@WITHOUT_DEVICE
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of NumPy, by which the simulator computes
def test_a_run_that_blows_up_says_so_on_cuda():
    sim = kd.Simulation(liquid(), engine="cuda", integrator="velocity-verlet", dt=0.5)
    with pytest.raises(kd.RunError, match=r"stopped at step 1 .*: a particle moves further than the skin of its list"):
        sim.run(5)
    near = liquid().remade(positions=np.vstack([[[0.5, 0.5, 0.5], [0.85, 0.5, 0.5]], liquid().state.positions[2:]]))
    with pytest.raises(kd.RunError, match="the forces are too large for their sums; particles are too near"):
        kd.Simulation(near, engine="cuda", integrator="velocity-verlet", dt=1e-9).run(2)


@WITHOUT_DEVICE
def test_a_law_that_the_device_cannot_compile_on_cuda(monkeypatch):
    from numba.core.errors import TypingError

    from kickdrift.engines.cuda.forces import PairForces

    def evaluate(forces, particles):
        raise TypingError("Failed in cuda mode pipeline\nUnknown attribute 'erfc' of math")

    monkeypatch.setattr(PairForces, "evaluate", evaluate)
    sim = kd.Simulation(liquid(), engine="cuda", **MD)
    said = "engine 'cuda': LennardJones: law does not compile for the device: .*; without --engine cuda the run is on"
    with pytest.raises(kd.InputError, match=said):
        sim.sample()


@WITHOUT_DEVICE
def test_force_checks_take_the_forces_of_cuda():
    system = liquid()
    ours, theirs = Evaluator(system), Evaluator(system, "cuda")
    for way in (0.0, 0.05):
        x = system.state.positions + way * np.sin(np.arange(81.0)).reshape(27, 3)
        expected, found = ours(x), theirs(x)
        assert np.abs(found.forces - expected.forces).max() < 1e-13 * np.abs(expected.forces).max()
        assert found.energy == pytest.approx(expected.energy, rel=1e-12)
        assert found.virial == pytest.approx(expected.virial, rel=1e-12)


@WITHOUT_DEVICE
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[2] Call to cuMemAlloc results in CUDA_ERROR_OUT_OF_MEMORY", "memory of the device is too small for 27 part"),
        ("[222] CUDA_ERROR_UNSUPPORTED_PTX_VERSION", "the driver refuses .* too old: .222. .*; without --engine cuda"),
    ],
)
def test_what_a_driver_refuses_on_cuda(text, said, monkeypatch):
    from kickdrift.engines.cuda.forces import PairForces

    def upload(forces, phase):
        raise RuntimeError(text)

    monkeypatch.setattr(PairForces, "upload", upload)
    with pytest.raises(kd.InputError, match=f"^engine 'cuda': .*{said}"):
        kd.Simulation(liquid(), engine="cuda", **MD).sample()


@WITHOUT_DEVICE
def test_cuda_says_how_many_particles_fit(monkeypatch):
    from kickdrift.engines.cuda import device

    class Context:
        def get_memory_info(self):
            return 2**30, 2**31

    monkeypatch.setattr(device.config, "ENABLE_CUDASIM", 0)
    monkeypatch.setattr(device.cuda, "current_context", Context, raising=False)
    device.check_room(1000, 1000)
    with pytest.raises(kd.InputError, match=r"10,000,000 particles need 9\.3 GiB, .* 1\.0 GiB free; about 1,073,741"):
        device.check_room(10_000_000, 1000)


def test_without_a_device(monkeypatch):
    from numba import cuda

    if SIMULATED or cuda.is_available():
        pytest.skip("there is a device")
    registry = sys.modules["kickdrift.engines"]
    monkeypatch.setattr(registry, "_version", lambda package: "0.30")
    with pytest.raises(kd.InputError, match=r"^engine 'cuda': no graphics processor answers: .*; without --eng"):
        kd.Simulation(liquid(), engine="cuda", **MD)


def test_other_runs_do_not_load_the_engine():
    code = (
        "import sys, kickdrift as kd; kd.Simulation(kd.load('lj-1000')); kd.listing('engines'); "
        "print([name for name in sys.modules if name.startswith('kickdrift.engines.cuda.')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"
