"""A box that changes its shape: exact distributions of its six components, other edges of its lattice, and refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import parsed
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.model.box.box import Images
from kickdrift.model.box.cell import cell_of, lengths_and_tilts, live_cell
from kickdrift.trajectory.overview import overview
from tests.long import rest
from tests.systems import liquid, needed

COUNT, PRESSURE, STIFFNESS = 8, 1.0, 400.0
BUMPS, WAVES = 0.7, 2.0 * math.pi * np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1], [1, -1, 0], [0, 1, -1]])
EDGES = np.array([[2.0, 0.0, 0.0], [0.9, 2.0, 0.0], [0.1, -0.3, 2.0]])
PARTS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
STRESS = np.array([[1.0, 0.25, 0.0], [0.25, -0.5, 0.15], [0.0, 0.15, 0.25]])
BAROSTATS: dict[str, dict[str, Any]] = {
    "c-rescale": {"pressure_tau": 0.5, "compressibility": 0.2, "pressure_every": 2},
    "mtk": {"pressure_tau": 0.5},
    "mtk in turns": {"barostat": "mtk", "pressure_tau": 0.5, "pressure_every": 4},
    "monte-carlo": {"compressibility": 0.2, "pressure_every": 2},
}


def options_of(barostat: str, name: str, **more: Any) -> dict[str, Any]:
    """A pressure, the full shape, and what bath and barostat need."""
    given = {"pressure": PRESSURE, "barostat": barostat, "coupling": "full"}
    return needed(name) | given | BAROSTATS[barostat] | more


def like_edges(rows: np.ndarray) -> np.ndarray:
    """The edge vectors of the same lattice that are most like EDGES."""
    found = rows.copy()
    for k, m in ((2, 1), (2, 0), (1, 0)):
        found[k] -= np.rint(found[k, m] / found[m, m] - EDGES[k, m] / EDGES[m, m]) * found[m]
    return found


def strain_of(rows: np.ndarray) -> np.ndarray:
    """Strain (G G^T - 1) / 2 of edge vectors, G = h0^-1 h, which does not depend on the frame."""
    growth = np.linalg.inv(EDGES) @ rows
    return 0.5 * (growth @ growth.T - np.eye(3))


def elastic(positions: np.ndarray, velocities: np.ndarray, time: float, box: kd.Box) -> tuple[Any, float, Any]:
    """An elastic box with the energy STIFFNESS tr(E^2) / 2 of the strain E, and particles in it.

    The particles scatter off each other by waves of their fractional coordinates s. This energy does not change with
    the box at the same s. So the particles have the density V^N of an ideal gas, and no virial."""
    rows = like_edges(box.matrix)
    inverse = np.linalg.inv(rows)
    phases = positions @ inverse @ WAVES.T
    c, s = np.cos(phases), np.sin(phases)
    energy = 0.5 * BUMPS * float((c.sum(axis=0) ** 2 + s.sum(axis=0) ** 2).sum())
    slopes = BUMPS * (c * s.sum(axis=0) - s * c.sum(axis=0)) @ WAVES
    growth, strain = np.linalg.inv(EDGES) @ rows, strain_of(rows)
    energy += 0.5 * STIFFNESS * float((strain**2).sum())
    return -slopes @ inverse.T, energy, -STIFFNESS * growth.T @ strain @ growth


def elastic_box() -> kd.System:
    rng = np.random.default_rng(3)
    v = rng.normal(size=(COUNT, 3))
    force = kd.PythonForce(elastic, external=False)
    return kd.System(
        rng.uniform(0, 1, (COUNT, 3)) @ EDGES, v - v.mean(axis=0), box=kd.Box(matrix=EDGES), forces=[force]
    )


def numbers_of(volume: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Volume, strains and their squares (…, 13)."""
    parts = np.stack([strain[..., i, j] for i, j in PARTS], axis=-1)
    return np.concatenate([np.asarray(volume)[..., None], parts, parts**2], axis=-1)


def expected(stress: np.ndarray, freedom: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of `numbers_of` with their standard errors, by importance sampling of S in h = h0 exp(S).

    The invariant measure is dS times sinh(a - b) / (a - b) of each pair of eigenvalues of S (Helgason 1984, Groups and
    Geometric Analysis, chapter I, theorem 5.8), times V; the gas gives V^(f / 3)."""
    rng, width, samples = np.random.default_rng(1), 0.065, 200_000
    z = rng.normal(0.0, width, (samples, 6))
    s = np.zeros((samples, 3, 3))
    for k, (i, j) in enumerate(PARTS):
        s[:, i, j] = s[:, j, i] = z[:, k] if i == j else z[:, k] * math.sqrt(0.5)
    values, vectors = np.linalg.eigh(s)
    log = 0.5 * (z**2).sum(axis=1) / width**2
    for i, j in ((0, 1), (0, 2), (1, 2)):
        apart = values[:, j] - values[:, i]
        log += np.log(np.sinh(apart) / apart)
    strain = 0.5 * (np.einsum("nij,nj,nkj->nik", vectors, np.exp(2 * values), vectors) - np.eye(3))
    first = np.linalg.det(EDGES)
    volume = first * np.exp(values.sum(axis=1))
    log -= 0.5 * STIFFNESS * (strain**2).sum(axis=(1, 2)) - first * np.einsum("ij,nij->n", stress, strain)
    log += (freedom / 3 + 1) * np.log(volume) - PRESSURE * volume
    weights = np.exp(log - log.max())
    weights /= weights.sum()
    found = numbers_of(volume, strain)
    mean = weights @ found
    return mean, np.sqrt(((weights[:, None] * (found - mean)) ** 2).sum(axis=0))


EXACT = ("mtk", "nose-hoover", True)
LONGER = [
    EXACT,
    ("c-rescale", "csvr", True),
    ("c-rescale", "baoab", False),
    ("mtk", "nose-hoover", False),
    ("mtk in turns", "nose-hoover", True),
]
LONGER += [("monte-carlo", "csvr", True), ("monte-carlo", "baoab", False)]


@pytest.mark.parametrize(
    ("barostat", "name", "stressed", "steps"),
    [(*EXACT, 10_000), *(rest(*each, 40_000) for each in LONGER)],
)
def test_an_elastic_box_has_its_exact_distribution(barostat, name, stressed, steps):
    stress = STRESS if stressed else np.zeros((3, 3))
    given = {"stress": [stress[i, j] for i, j in PARTS]} if stressed else {}
    strong = {"friction": 2.0} if name == "baoab" else {"tau": 0.3}
    sim = kd.Simulation(elastic_box(), name, 0.02, **options_of(barostat, name, **given, **strong))
    sim.advance(1000)
    rows: list[np.ndarray] = []
    sim.advance(steps, every=20, visit=lambda run: rows.append(run.state.box.matrix))
    tilts = np.array([each[1, 0] / each[0, 0] for each in rows])
    assert tilts.min() < -0.3 < 0.3 < tilts.max()  # the box has taken other edges, and gone back
    found = np.array([numbers_of(np.linalg.det(each), strain_of(like_edges(each))) for each in rows])
    blocks = found.reshape(25, -1, found.shape[1]).mean(axis=1)
    mean, error = expected(stress, 3 * COUNT if name == "baoab" else 3 * COUNT - 3)
    scatter = np.hypot(blocks.std(axis=0, ddof=1) / math.sqrt(len(blocks)), error)
    assert np.abs((blocks.mean(axis=0) - mean) / scatter).max() < 4.0


def test_a_box_has_the_shortest_vectors_of_its_lattice():
    """Compiled code finds vectors as short as Python's, and their inverse, for boxes that lean as far as may be."""
    rng = np.random.default_rng(2)
    for plane in (False, True):
        for _ in range(50):
            rows = np.diag(rng.uniform(0.3, 1.0, 3))
            rows[[1, 2, 2], [0, 0, 1]] = rng.uniform(-0.5, 0.5, 3) * rows[[0, 0, 1], [0, 0, 1]]
            rows[2] *= not plane
            box = kd.Box(matrix=rows[:2, :2] if plane else rows)
            cell, wanted = live_cell(cell_of(box), lengths_and_tilts(rows)), box.images
            axes = 3 - plane
            found = Images(cell.reduced[:axes], cell.inverse[:, :axes], cell.neighbours, float(cell.sure2[0]))
            lengths = [np.sort(np.linalg.norm(each.reduced, axis=1)) for each in (found, wanted)]
            np.testing.assert_allclose(*lengths, rtol=1e-12)
            np.testing.assert_allclose(found.reduced @ found.inverse, np.eye(axes), atol=1e-12)
            assert found.sure2 == pytest.approx(wanted.sure2, rel=1e-12)
            assert len(found.neighbours) == len(wanted.neighbours)


def crystal(shear: float = 0.0, cells: int = 3, cutoff: float = 2.2) -> kd.System:
    """An fcc crystal of Lennard-Jones particles near its lattice constant at rest, sheared along x."""
    a = 1.58
    sites = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    places = np.indices((cells,) * 3).reshape(3, -1).T
    x = a * (places[:, None] + sites).reshape(-1, 3)
    rows = cells * a * np.array([[1.0, 0, 0], [shear, 1.0, 0], [0.3 * shear, -0.5 * shear, 1.0]])
    v = np.random.default_rng(1).normal(0.0, 0.3, x.shape)
    law = kd.LennardJones(cutoff=cutoff, truncation="switch")
    return kd.System(x @ rows / (cells * a), v - v.mean(axis=0), box=kd.Box(matrix=rows), forces=[law])


SOLID = {"temperature": 0.1, "pressure": 0.0, "compressibility": 0.01}


@pytest.mark.parametrize("barostat", [rest("c-rescale"), "mtk", rest("monte-carlo")])
def test_a_sheared_crystal_relaxes_to_its_lattice_with_the_same_bits(barostat, tmp_path):
    """However the run is cut, looked at or shared among threads; the file has the box of each frame."""
    name = "nose-hoover" if barostat == "mtk" else "csvr"
    own = {"pressure_tau": 0.3, "compressibility": 0.01, "pressure_every": 3}
    kept = {key: value for key, value in own.items() if key in BAROSTATS[barostat]}
    given = options_of(barostat, name, **{**SOLID, "tau": 0.1, **kept})
    given = {key: value for key, value in given.items() if key != "compressibility" or barostat != "mtk"}

    def made(threads: int = 1) -> kd.Simulation:
        return kd.Simulation(crystal(0.08), name, 0.004, threads, **given)

    def end(sim: kd.Simulation) -> bytes:
        return sim.state.phase.tobytes() + repr(sim.state.box).encode()

    whole, cut, again = made(), made(2), made(2)
    whole.run(1500, every=50, output=tmp_path / "run.h5md")
    cut.advance(707)
    point = cut.checkpoint()
    cut.advance(793)
    again.restore(point)
    again.run(793, every=7)
    assert end(cut) == end(again) == end(whole)
    sim = kd.resume(tmp_path / "run.h5md", step=707)
    sim.run(1500 - sim.steps_done)
    assert end(sim) == end(whole)
    with kd.open(tmp_path / "run.h5md") as run:
        boxes = run[:].boxes
    tilts = np.array([box.matrix[[1, 2, 2], [0, 0, 1]] for box in boxes])
    assert tilts[0] == pytest.approx(crystal(0.08).box.tilts)
    assert np.abs(tilts[-10:].mean(axis=0)).max() < 0.25 * np.abs(tilts[0]).max()
    assert boxes[-1] == whole.state.box


def test_a_liquid_does_not_hold_the_shape_of_its_box():
    start = liquid(125, 1.6)
    sim = kd.Simulation(start, "csvr", 0.004, **options_of("c-rescale", "csvr", pressure=1.0, pressure_tau=0.1))
    report = sim.run(3000, every=50)
    assert any("a fluid does not hold the shape of its box" in line for line in report.warnings)
    now = sim.now()
    tensor = instantaneous_pressure(now, now.state.positions, now.state.velocities)
    found = sim.record.samples[-1].columns["pressure_tensor"]
    np.testing.assert_allclose(found, [tensor[place] for place in PARTS], rtol=1e-8, atol=1e-10)
    assert sim.pressure() == pytest.approx(np.trace(tensor) / 3)


def test_a_report_has_each_component_of_the_pressure(tmp_path):
    stress = (0.5, 0.0, 0.0, 0.0, 0.0, 0.25)
    given = SOLID | {"pressure": 0.2, "compressibility": 0.03, "tau": 0.1, "pressure_tau": 0.1, "pressure_every": 5}
    sim = kd.Simulation(crystal(), "csvr", 0.004, **options_of("c-rescale", "csvr", stress=stress, **given))
    sim.advance(500)
    report = sim.run(6000, every=10, output=tmp_path / "run.h5md")
    found = report.tensor
    assert found.names == ("xx", "yy", "zz", "yz", "xz", "xy")
    assert found.asked == pytest.approx((-0.3, 0.2, 0.2, 0.0, 0.0, -0.25))
    assert np.mean(found.means[:3]) == pytest.approx(report.pressure)
    off = [abs(mean - asked) / error for mean, asked, error in zip(found.means, found.asked, found.errors, strict=True)]
    assert max(off) < 5.0
    assert "asked -0.25 ε/σ^3: agrees" in str(report)
    assert report.as_json()["tensor"]["asked"][5] == -0.25
    lines = [line for line in overview(tmp_path / "run.h5md") if line[0].startswith("pressure ")]
    assert lines == found.lines("ε/σ^3")
    assert "asked -0.25 eV/angstrom^3 = -40.054 GPa: agrees" in found.lines("eV/angstrom^3")[5][1]


def test_positions_stay_continuous_when_the_box_takes_other_edges(tmp_path):
    """A strong shear stress turns a tilt by more than half an edge: the box then has other edges of its lattice."""
    rows = np.array([[4.0, 0.0, 0.0], [1.9, 4.0, 0.0], [0.0, 0.0, 4.0]])
    start = liquid(64, 1.5)
    x = start.state.positions @ np.linalg.inv(start.box.matrix) @ rows
    system = kd.System(x, start.state.velocities, box=kd.Box(matrix=rows), forces=start.forces)
    given = options_of("c-rescale", "csvr", pressure=3.0, stress=[0, 0, 0, 0, 0, 4.0], pressure_tau=0.4)
    sim = kd.Simulation(system, "csvr", 0.002, **given)
    path = tmp_path / "run.h5md"
    sim.run(500, every=5, output=path, file=kd.FileOptions(write=["images"]))
    with kd.open(path) as run:
        frames = run[:]
        boxes, positions = frames.boxes, frames.positions
    tilts = np.array([box.matrix[1, 0] / box.matrix[0, 0] for box in boxes])
    assert np.abs(np.diff(tilts)).max() > 0.5
    assert np.abs(tilts).max() <= 0.5 + 1e-9
    assert np.abs(np.diff(positions, axis=0)).max() < 0.5
    held = kd.Simulation(system.with_forces(*system.forces, kd.Restraint(1e-9)), "csvr", 0.002, **given)
    why = "the tilt xy of the box is 0.5.*, more than a half, .* under force 'restraint': its reference positions"
    with pytest.raises(RunError, match=why):
        held.run(500)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"stress": [1, 2, 3]}, r"stress must be 6 numbers, xx, yy, zz, yz, xz, xy, got \[1, 2, 3\]"),
        ({"stress": [0, 0, "1 GPa"]}, r"stress must be 6 numbers, xx, .*, got \[0, 0, '1 GPa'\]"),
        ({"stress": [1, 2, 3, 0, 0, math.nan]}, r"stress\[5\] must be a finite number, got nan"),
        ({"stress": [0] * 6, "coupling": "per-axis"}, "stress: needs coupling = full"),
        ({"stress": [0] * 6, "pressure": None, "coupling": None}, ".*: is an option of a barostat, which needs a pres"),
    ],
)
def test_wanted_stresses_that_make_no_sense(options, line):
    given = {key: value for key, value in options_of("mtk", "nose-hoover").items() if key not in options} | options
    with pytest.raises(InputError, match=f"^{line}"):
        kd.Simulation(crystal(), "nose-hoover", 0.004, **given)


def test_a_stress_on_the_command_line_is_as_in_a_file():
    numbers = (0.0, 0.0, "1 GPa", 0.0, 0.0, -2.5)
    for text in ("0,0,1 GPa,0,0,-2.5", '[0, 0, "1 GPa", 0, 0, -2.5]'):
        assert parsed([f"stress={text}"], {}) == {"stress": numbers}


def test_a_box_that_becomes_too_narrow_stops_the_run():
    given = options_of("c-rescale", "csvr", **(SOLID | {"pressure": 80.0, "pressure_tau": 0.5}))
    with pytest.raises(
        RunError, match=r"would make the box height across [abc] 4\.3\d*, shorter than twice the cutoff"
    ):
        kd.Simulation(crystal(), "csvr", 0.002, **given).run(5000, every=10)
