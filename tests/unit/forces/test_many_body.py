"""Many-body forces: energies, forces and virials against plain NumPy, in boxes of every shape; lists; bad input."""

from __future__ import annotations

import itertools
import os
from functools import partial

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.many_body.stillinger_weber import SiliconOf1985
from kickdrift.forces.many_body.tables import COULOMB, hermite
from kickdrift.forces.many_body.tersoff import SiliconOf1988
from kickdrift.forces.slopes.variations import varied
from kickdrift.model.starts.builders import lattice
from kickdrift.systemfile.reading import loads
from kickdrift_validation import zhou_copper
from kickdrift_validation.example_forces import crystal, example
from tests.long import shortened
from tests.oracle import many_body as oracle

LEANING = np.array([[14.1, 0, 0], [-5.0, 14.3, 0], [3.3, 4.0, 13.5]])
BOXES = {
    "open": None,
    "cube": kd.Box([12.0, 12.5, 13.0]),
    "narrow": kd.Box([11.6, 11.7, 11.5]),
    "leaning": kd.Box(matrix=LEANING),
    "slab": kd.Box([12.0, 12.5, 13.0], periodic=(True, False, True)),
}
SILICON, CARBON = SiliconOf1985()._asdict(), SiliconOf1988()._asdict()


def triples(of: dict[str, dict], mixed) -> dict[str, dict]:
    """Entries for all triples of two species: ``mixed`` makes an entry from those of three species."""
    return {"-".join(t): mixed(*(of[each] for each in t)) for t in itertools.product(of, repeat=3)}


def mixed_weber(i: dict, j: dict, k: dict) -> dict:
    pair = {key: 0.5 * (i[key] + j[key]) for key in i} if j is k else dict(i)
    return pair | {
        "cos_theta0": (i["cos_theta0"] + 0.1 * (j["p"] + k["p"])) / 2,
        "lambda_": i["lambda_"] + j["a"] * k["a"],
    }


def mixed_tersoff(i: dict, j: dict, k: dict) -> dict:
    ends = {key: 0.5 * (i[key] + k[key]) for key in ("R", "D")}  # those of the bond i-k-k
    bond = {key: 0.5 * (i[key] + j[key]) for key in ("A", "B", "lambda1", "lambda2", "beta", "n")}
    return i | ends | bond | {"gamma": 1.0 + 0.1 * j["R"], "cos_theta0": -0.1 * k["R"], "m": j["m"]}


WEBERS = triples({"Si": SILICON, "Xx": SILICON | {"sigma": 1.9, "p": 3.5, "q": 0.5, "epsilon": 1.7}}, mixed_weber)
TERSOFFS = triples(
    {"Si": CARBON, "C": CARBON | {"R": 2.6, "D": 0.3, "A": 2000.0, "n": 0.8, "beta": 1e-2, "m": 1.0, "lambda3": 0.4}},
    mixed_tersoff,
)

ENDS = {key: each | {"R": each["R"] - 0.1 * key.startswith("Si-C-S")} for key, each in TERSOFFS.items()}  # of a triple
ENDS["C-C-C"] = ENDS["C-C-C"] | {"D": 0.0}  # a sharp cutoff


def copper_tables(points: int = 300) -> dict:
    dr, drho = zhou_copper.CUTOFF / points, zhou_copper.HIGHEST / points
    r, rho = np.arange(points + 1) * dr, np.arange(points + 1) * drho
    copper, pair = zhou_copper.density(r), r * zhou_copper.pair_energy(r)
    return {
        "cutoff": zhou_copper.CUTOFF, "dr": dr, "drho": drho,
        "embedding": {"Cu": zhou_copper.embedding(rho), "Ag": 0.9 * zhou_copper.embedding(rho) + 0.01 * rho},
        "density": {
            ("Cu", "Cu"): copper, ("Cu", "Ag"): 1.1 * copper, ("Ag", "Cu"): 0.9 * copper, ("Ag", "Ag"): 1.2 * copper,
        },
        "rphi": {
            ("Cu", "Cu"): pair, ("Cu", "Ag"): 1.1 * pair, ("Ag", "Cu"): 1.1 * pair, ("Ag", "Ag"): 0.9 * pair,
        },
    }  # fmt: skip


def written(path, tables: dict, elements: tuple[str, ...], form: str = "alloy") -> str:
    """Write tables as funcfl, setfl, or a form with densities of pairs, listed by the atom that they come from."""
    n, fs = len(tables["embedding"]["Cu"]), form != "alloy"
    sizes = f"{n} {tables['drho']!r} {n} {tables['dr']!r} {tables['cutoff']!r}"
    if form == "funcfl":
        rows = (tables["embedding"]["Cu"], tables["charge"], tables["density"]["Cu", "Cu"])
        numbers = " ".join(f"{value:.17E}".replace("E", "D") for value in np.concatenate(rows))  # Fortran's
        path.write_text(f"copper\r\n29 63.546 3.615 fcc\r\n{sizes}\r\n" + numbers.replace(" ", "\r\n"))
        return str(path)
    lines = ["", "", "", f"{len(elements)} {' '.join(elements)}"]
    lines += [f"{sizes} {tables['first'] + (n - 1) * tables['drho']!r}" if form == "he" else sizes]
    for a in elements:
        rows = [tables["embedding"][a]]
        rows += [tables["density"][b, a] for b in elements] if fs else [tables["density"][a, a]]
        lines += ["29 63.546 3.615 fcc", *(f"{value!r}" for row in rows for value in row.tolist())]
    for a, b in ((a, b) for k, a in enumerate(elements) for b in elements[: k + 1]):
        lines += [f"{value!r}" for value in tables["rphi"][a, b].tolist()]
    path.write_text("\n".join([*lines, ""]))
    return str(path)


def alloyed(tables: dict) -> dict:
    """Tables of an alloy: the density depends on the atom that it comes from alone."""
    return tables | {"density": {(a, b): tables["density"][b, b] for a, b in tables["density"]}}


def charged(tables: dict) -> tuple[dict, dict]:
    """Tables whose pair energy is that of two charges, and what LAMMPS keeps: all points but the last."""
    tables = tables | {"cutoff": tables["cutoff"] - 2 * tables["dr"]}
    charge = np.sqrt(np.abs(tables["rphi"]["Cu", "Cu"]) / COULOMB)
    kept = {
        "embedding": {"Cu": tables["embedding"]["Cu"][:-1]},
        "density": {("Cu", "Cu"): tables["density"]["Cu", "Cu"][:-1]},
        "rphi": {("Cu", "Cu"): COULOMB * charge[:-1] ** 2},
    }  # fmt: skip
    return tables | {"charge": charge}, tables | kept


def below_zero(tables: dict) -> dict:
    """Tables whose embedding energies begin at a negative density."""
    rho = np.arange(len(tables["embedding"]["Cu"])) * tables["drho"] - 5.0
    energies = {name: factor * 0.01 * (rho - 3.0) ** 2 for name, factor in (("Cu", 1.0), ("Ag", 0.7))}
    return tables | {"first": -5.0, "embedding": energies}


def at_oracle(tables: dict, d, s) -> complex:
    return oracle.embedded_atom(d, s, tables)


def case(name: str, folder):
    """A force, its species, and its energy as a function of separations and species."""
    if name == "stillinger-weber":
        return kd.StillingerWeber(), ["Si"], lambda d, s: oracle.stillinger_weber(d, s, {"Si-Si-Si": SILICON})
    if name == "stillinger-weber, two":
        return kd.StillingerWeber(WEBERS), ["Si", "Xx"], lambda d, s: oracle.stillinger_weber(d, s, WEBERS)
    if name == "tersoff":
        return kd.Tersoff(), ["Si"], lambda d, s: oracle.tersoff(d, s, {"Si-Si-Si": CARBON})
    if name == "tersoff, two":
        return kd.Tersoff(TERSOFFS), ["Si", "C"], lambda d, s: oracle.tersoff(d, s, TERSOFFS)
    if name == "tersoff, ends":
        return kd.Tersoff(ENDS), ["Si", "C"], lambda d, s: oracle.tersoff(d, s, ENDS)
    tables, form = copper_tables(), name.split()[-1] if name.endswith(("fs", "he", "funcfl")) else "alloy"
    if form == "funcfl":
        tables, kept = charged(tables)
        return kd.EmbeddedAtom(written(folder / "a.eam", tables, ("Cu",), form)), ["Cu"], partial(at_oracle, kept)
    if form == "alloy":
        tables = alloyed(tables)
    if form == "he":
        tables = below_zero(tables)
    elements = ("Cu",) if name == "eam" else ("Cu", "Ag")
    file = written(folder / f"a.eam.{form}", tables, elements, form)
    return kd.EmbeddedAtom(file), list(elements), lambda d, s: oracle.embedded_atom(d, s, tables)


CASES = [
    "stillinger-weber", "stillinger-weber, two", "tersoff", "tersoff, two", "tersoff, ends", "eam", "eam, two",
    "eam, two, fs", "eam, two, he", "eam, funcfl",
]  # fmt: skip


def particles(species: list[str], box, force, n: int = 40) -> kd.System:
    """Particles at random, not too near each other; some are several boxes away."""
    rng = np.random.default_rng(n)
    places: list[np.ndarray] = []
    edges = np.diag(box.matrix) if box is not None and box.periodic else np.array([9.0, 9.0, 9.0])
    edges = np.where(edges > 0, edges, 9.0)
    while len(places) < n:
        x = rng.uniform(0, np.minimum(edges, 9.0))
        if all(np.linalg.norm(x - y) > 1.8 for y in places):
            places.append(x)
    x = np.array(places)
    if box is not None:
        x = x + box.cartesian(np.where(box.periodic_axes, rng.integers(-2, 3, (n, 3)), 0))
    names = [species[k % len(species)] for k in range(n)]
    return kd.System(x, masses=20.0, box=box, forces=[force], units="metal", species=names)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("shape", BOXES)
def test_energy_forces_and_virial_are_those_of_the_papers(name, shape, tmp_path):
    if name.startswith("eam"):
        pytest.importorskip("ase")
    force, species, energy = case(name, tmp_path)
    system = particles(species, BOXES[shape], force)
    names = [system.species[k] for k in system.species_index]
    d = oracle.separations(system.state.positions, system.box)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    expected = float(np.real(energy(d.astype(complex), names)))
    assert measured.potential == pytest.approx(expected, rel=1e-12)
    forces = (measured.accelerations * system.coherent_masses).T
    for seed in range(3):
        way = np.random.default_rng(seed).normal(size=forces.shape)
        along = oracle.slope(lambda w: energy(d + w, names), way[None, :] - way[:, None])
        assert -along == pytest.approx(float((forces * way).sum()), rel=1e-11, abs=1e-11 * np.linalg.norm(forces))
    grown = oracle.slope(lambda w: energy(d + w, names), d)
    assert measured.virial == pytest.approx(-grown, rel=1e-11)


MIXED = [(name, shape) for name in CASES for shape in ("open", "leaning")]


@pytest.mark.parametrize("each", shortened(MIXED, [("tersoff, two", "leaning"), ("eam, two, fs", "open")]), ids=str)
def test_mixed_precision_differs_by_the_rounding_of_float32(each, tmp_path):
    name, shape = each
    if name.startswith("eam"):
        pytest.importorskip("ase")
    force, species, _ = case(name, tmp_path)
    system = particles(species, BOXES[shape], force)
    double, mixed = (BoundForces(system, mixed=mixed).measure(0.0, system.state.phase) for mixed in (False, True))
    scale = np.sqrt((double.accelerations**2).mean())
    assert 1e-9 * scale < np.abs(mixed.accelerations - double.accelerations).max() < 1e-5 * scale
    assert np.abs(mixed.accelerations.sum(axis=1)).max() < 1e-12 * scale * len(system)  # all masses are equal
    assert mixed.pairs == double.pairs
    assert mixed.potential == pytest.approx(double.potential, rel=1e-6)
    assert mixed.virial == pytest.approx(double.virial, rel=1e-5, abs=1e-5 * abs(double.potential))


@pytest.mark.parametrize("name", ["silicon-512", "copper-864"])
def test_mixed_precision_gives_the_same_bits_on_threads_and_in_pieces(name):
    if name.startswith("copper"):
        pytest.importorskip("ase")
    one, other = (kd.Simulation(kd.load(name), dt=0.001, threads=k, precision="mixed") for k in (1, 2))
    one.run(30, every=30)
    for _ in range(3):
        other.run(10, every=5)
    np.testing.assert_array_equal(one.state.positions, other.state.positions)


SLOPES = [(name, shape) for name in CASES for shape in ("open", "leaning")]


@pytest.mark.parametrize("each", shortened(SLOPES, []), ids=str)
def test_slopes_are_those_of_the_papers(each, tmp_path):
    """Differences of order 6 of derivatives by a complex step. With tables h is small, so that no distance passes a
    point of its table, and rounding is what is left."""
    name, shape = each
    if tables := name.startswith("eam"):
        pytest.importorskip("ase")
    force, species, energy = case(name, tmp_path)
    system = particles(species, BOXES[shape], force)
    names = [system.species[k] for k in system.species_index]
    n, rng = len(system), np.random.default_rng(7)
    deviations, h, bound = rng.normal(size=(2, 3, n, 2)), 1e-6 if tables else 3e-4, 1e-9 if tables else 3e-11
    made = varied(system, deviations.reshape(2, 3, -1))
    found = BoundForces(made).measure(0.0, made.state.phase).accelerations
    plain = BoundForces(system).measure(0.0, system.state.phase)
    np.testing.assert_array_equal(found[:, :n], plain.accelerations)
    slopes = found[:, n:].reshape(3, n, 2) * system.coherent_masses[:, None]
    d = oracle.separations(system.state.positions, system.box)
    for k in range(2):
        along, way = deviations[0, :, :, k].T, rng.normal(size=(n, 3))
        ahead, apart = along[None, :] - along[:, None], way[None, :] - way[:, None]

        def there(m: int, ahead=ahead, apart=apart) -> float:
            return -oracle.slope(lambda w: energy(d + m * h * ahead + w, names), apart)

        wanted = (45 * (there(1) - there(-1)) - 9 * (there(2) - there(-2)) + (there(3) - there(-3))) / (60 * h)
        size = np.linalg.norm(slopes[..., k]) * np.linalg.norm(way)
        assert float((slopes[..., k].T * way).sum()) == pytest.approx(wanted, rel=0, abs=bound * size)


@pytest.mark.parametrize("name", ["eam", "stillinger-weber"])
def test_room_for_neighbours_grows(name):
    system = crystal(example(kd.forces.FORCES[name]))
    whole, small = BoundForces(system), BoundForces(system)
    small.forces = tuple(force.with_row_room(8) for force in small.forces)
    measured = [each.measure(0.0, system.state.phase) for each in (whole, small)]
    assert small.forces[0].row_room > 8
    np.testing.assert_array_equal(measured[0].accelerations, measured[1].accelerations)
    assert measured[0].potential == measured[1].potential


@pytest.mark.parametrize("name", ["eam", "stillinger-weber", "tersoff"])
def test_sums_are_taken_again_only_at_the_same_positions(name):
    system = crystal(example(kd.forces.FORCES[name]))
    kept, other, start = BoundForces(system), BoundForces(system), system.state.phase
    moved = start.copy()
    moved[0, 2, 5] += 0.01  # less than the skin: both lists stay as they are at the start
    found = [kept.measure(0.0, y) for y in (start, start, moved, moved, start)]
    summed = [other.measure(0.0, y) for y in (start, moved, start)]
    for each, wanted in zip(found, [summed[k] for k in (0, 0, 1, 1, 2)], strict=True):
        np.testing.assert_array_equal(each.accelerations, wanted.accelerations)
        assert (each.potential, each.virial) == (wanted.potential, wanted.virial)
    assert summed[0].potential == summed[2].potential != summed[1].potential


@pytest.mark.parametrize("name", ["eam", "stillinger-weber", "tersoff"])
def test_a_run_does_not_depend_on_the_order_of_particles(name):
    system = crystal(example(kd.forces.FORCES[name]))
    order = np.random.default_rng(3).permutation(len(system))
    state = system.state
    species = [system.species[k] for k in system.species_index]
    mixed = kd.System(
        state.positions[order], state.velocities[order], state.masses, system.box, system.forces, "metal", species
    )
    whole, other = (kd.Simulation(each, dt=0.002) for each in (system, mixed))
    whole.run(40)
    other.run(40)
    np.testing.assert_array_equal(other.state.positions, whole.state.positions[order])
    assert whole.report().energy.max_relative_error < 1e-4


def test_a_cubic_through_a_cubic_is_the_cubic():
    """Slopes over five points are exact for cubics; the first two and the last two intervals have other slopes."""
    x = np.arange(12.0)
    f = x**3 - 2 * x**2 + 3
    cubics, p = hermite(f), 0.3
    for m in range(2, 9):
        here = np.polyval(cubics[m], p)
        assert here == pytest.approx((m + p) ** 3 - 2 * (m + p) ** 2 + 3, rel=1e-14)


def test_the_shipped_copper_is_the_published_formula():
    shipped = example(kd.EmbeddedAtom).file
    with open(shipped) as file:
        assert file.read() == zhou_copper.setfl()


def test_silicon_has_its_published_lattice_constant_and_energy():
    def energy(a: float) -> float:
        x = (np.indices((3, 3, 3)).reshape(3, -1).T[:, None] + SITES).reshape(-1, 3) * a
        system = kd.System(
            x, masses=28.0855, box=[3 * a] * 3, forces=[kd.StillingerWeber()], units="metal", species=["Si"] * 216
        )
        return kd.Simulation(system, dt=0.001).energy().potential / 216

    fcc = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    SITES = np.concatenate([fcc, fcc + 0.25])
    assert energy(5.431) == pytest.approx(-4.3366, abs=1e-4)  # two bonds of depth epsilon for each atom
    assert energy(5.431) == pytest.approx(-2 * SILICON["epsilon"], rel=1e-6)
    assert energy(5.431) < min(energy(5.425), energy(5.437))


def test_a_run_goes_on_from_its_file_until_the_potential_changes(tmp_path, monkeypatch):
    pytest.importorskip("ase")
    file = written(tmp_path / "copper.eam.alloy", alloyed(copper_tables()), ("Cu",))
    monkeypatch.chdir(tmp_path)
    system = crystal(kd.EmbeddedAtom("copper.eam.alloy"))
    whole, part = kd.Simulation(system, dt=0.002), kd.Simulation(system, dt=0.002)
    whole.run(20, every=10)
    part.run(10, every=10, output=tmp_path / "run.h5md")
    monkeypatch.chdir("/")
    again = kd.resume(tmp_path / "run.h5md")
    again.run(10)
    np.testing.assert_array_equal(again.state.phase, whole.state.phase)
    written(tmp_path / "copper.eam.alloy", alloyed(copper_tables(301)), ("Cu",))
    with pytest.raises(InputError, match=r"copper.eam.alloy has changed"):
        kd.resume(tmp_path / "run.h5md")
    (tmp_path / "copper.eam.alloy").unlink()
    with pytest.raises(InputError, match=rf"eam: file: {file}: no such file"):
        kd.resume(tmp_path / "run.h5md")


def test_a_file_of_entries_gives_the_entries(tmp_path):
    (tmp_path / "Si.sw").write_text(
        "# a comment\nSi Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.3333\n 7.0 0.6 4.0 0.0 0.0 # end\n"
    )
    text = 'units = "metal"\n[particles]\npositions = [[0.0, 0.0, 0.0], [2.3, 0.0, 0.0]]\nmass = 28.0\nspecies = "Si"\n'
    system = loads(text + '[[force]]\ntype = "stillinger-weber"\nfile = "Si.sw"\n', folder=tmp_path)
    force = system.forces[0]
    assert force.file is None
    assert force.entries == {"Si-Si-Si": SILICON | {"cos_theta0": -0.3333, "A": 7.0, "B": 0.6}}
    assert loads(system.to_toml()).forces == system.forces


# --- Tersoff's other forms ---

MOD = (
    "3.0 1.80536502 -0.38136087 2.16152496 1 1.39343356 117.7807244 2.87478837 0.33090566 3.18011795 3198.51383127 "
    "1.98633876 0.20123243 614230.04 996439.1 3.33560562 25.2096377"
)  # Purja Pun & Mishin 2017, doi:10.1103/PhysRevB.95.224103
CARBON_LINE = "1 1 0 19981 7.034 -0.33953 0.99054 4.1612e-6 2.3064 389.63 1.95 0.15 3.4653 1544.8"
FORMS = {"mod": ("tersoff/mod", MOD), "modc": ("tersoff/mod/c", f"{MOD} -0.00592042"),
         "zbl": ("tersoff/zbl", f"{CARBON_LINE} 6 6 0.95 14")}  # fmt: skip


def of_form(folder, form: str) -> str:
    (folder / f"C.tersoff.{form}").write_text(f"# UNITS: metal\nC C C {FORMS[form][1]}\n")
    return str(folder / f"C.tersoff.{form}")


@pytest.mark.parametrize("form", shortened(FORMS, [form for form in FORMS if form != "zbl"]))
def test_other_forms_are_those_of_lammps(tmp_path, form):
    """A shaken crystal, with one pair so close that the nuclei repel each other."""
    own = kd.Tersoff(of_form(tmp_path, form))
    x, edges = lattice("diamond", 64, 64 / (2.0 * own.cutoff + 0.5) ** 3)
    x = x + np.random.default_rng(1).uniform(-0.1, 0.1, x.shape)
    x[1] = x[0] + [0.3, 0.4, 0.5]
    system = kd.System(x, masses=12.0, box=edges, forces=[own], units="metal", species=["C"] * 64)
    other = system.with_forces([kd.LammpsForce(FORMS[form][0], f"* * {of_form(tmp_path, form)} C")])
    found, expected = (kd.Simulation(each, dt=0.001) for each in (system, other))
    assert found.energy().potential == pytest.approx(expected.energy().potential, rel=1e-12)
    forces = expected.forces()
    np.testing.assert_allclose(found.forces(), forces, rtol=0, atol=1e-11 * np.abs(forces).max())
    assert found.sample().pressure == pytest.approx(expected.sample().pressure, rel=1e-11)
    assert kd.Simulation(loads(system.to_toml()), dt=0.001).energy().potential == found.energy().potential


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_files_with_fortrans_exponents_and_other_ends_of_lines(tmp_path, ending):
    for number in ("4.1612e-6", "4.1612D-06", "4.1612d-6"):
        line = CARBON_LINE.replace("4.1612e-6", number)
        (tmp_path / "C.tersoff").write_text(f"# one{ending}C C C {line} # end{ending}", newline="")
        assert kd.Tersoff(str(tmp_path / "C.tersoff")).entries["C-C-C"]["beta"] == 4.1612e-6


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("C.tersoff.mod", f"C C C {MOD[:-3]}\nC C", r"file: \S*C.tersoff.mod: expected entries of three elements"),
        ("C.tersoff.zbl", f"C C C {CARBON_LINE} 6 6 0.95", r"three elements and 18 numbers, got 20 words"),
        ("C.tersoff", f"# UNITS: real\nC C C {CARBON_LINE}", r"its first line says UNITS: real; expected metal"),
        ("C.tersoff.mod", f"C C C {MOD.replace('1.98633876', '0.0')}", r"tersoff: C-C-C: nu must be positive, got 0"),
    ],
)  # fmt: skip
def test_files_of_other_forms_that_are_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        kd.Tersoff(str(tmp_path / name))


# --- bad input ---


def two(force, **arguments) -> kd.System:
    arguments = {"units": "metal", "species": ["Si", "Si"], "masses": 28.0} | arguments
    return kd.System([[0, 0, 0], [2.4, 0, 0]], forces=[force], **arguments)


def test_a_system_that_does_not_fit_is_refused():
    force = kd.StillingerWeber()
    for arguments, message in (
        ({"topology": kd.Topology(exclusions=[(0, 1)])}, r"a topology can leave out or scale only pair forces"),
        (
            {"units": "lj"},
            r"stillinger-weber: its parameters are in eV and angstroms, which needs units 'metal', not 'lj'",
        ),
        ({"species": ["Si", "Ge"]}, r"species 'Ge' has no parameters in the default, which has Si"),
        (
            {"box": [7.0, 20.0, 20.0]},
            r"stillinger-weber: box edge x is 7 angstrom, shorter than twice the cutoff, 2 x 3.77118",
        ),
        ({"dimensions": 2}, r"stillinger-weber: works in three dimensions, and the system has 2"),
        ({"masses": [1.0, 0.0]}, r"stillinger-weber: particle 1 has no mass"),
    ):
        with pytest.raises(InputError, match=message):
            two(force, **arguments)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.StillingerWeber(file="no.sw"), r"stillinger-weber: file: no.sw: no such file"),
        (lambda: kd.Tersoff("no.tersoff"), r"tersoff: file: no.tersoff: no such file"),
        (lambda: kd.Tersoff("a.tersoff", file="b.tersoff"), r"give one file, not 'a.tersoff' and 'b.tersoff'"),
        (lambda: kd.StillingerWeber(file="a.txt"), r"file: expected a name that ends in .sw, got 'a.txt'"),
        (lambda: kd.StillingerWeber({}, "a.sw"), "give entries or a file, not both"),
        (lambda: kd.StillingerWeber({"Si": SILICON}), r"expected three species such as 'Si-Si-Si', got 'Si'"),
        (lambda: kd.StillingerWeber({"Si-Si-Si": {"a": 1.0}}), r"entries.Si-Si-Si: epsilon: required key is missing"),
        (lambda: kd.StillingerWeber({"Si-Si-Si": SILICON | {"x": 1}}), r"unknown key 'x'; expected epsilon"),
        (lambda: kd.StillingerWeber({"Si-Si-Si": SILICON | {"sigma": 0}}), r"Si-Si-Si: sigma must not be negative"),
        (lambda: kd.Tersoff({"Si-Si-Si": CARBON | {"D": 4.0}}), r"D = 4 must be less than R = 3"),
        (lambda: two(kd.Tersoff({"Si-Si-Si": CARBON | {"m": 2}})), r"tersoff: Si-Si-Si: m must be 1 or 3, got 2"),
        (
            lambda: two(kd.StillingerWeber({"Si-Si-Si": SILICON, "Ge-Ge-Ge": SILICON}), species=["Si", "Ge"]),
            r"entries has no parameters for Si-Si-Ge",
        ),
        (lambda: kd.EmbeddedAtom("no.eam.alloy"), r"eam: file: no.eam.alloy: no such file"),
        (lambda: kd.EmbeddedAtom("Cu.meam"), r"a name that ends in .eam, .eam.alloy, .eam.fs, .eam.he, got 'Cu.meam'"),
        (
            lambda: kd.Tersoff(elements={"C": "Si"}, entries={"C-C-C": CARBON}),
            r"species 'C', called 'Si', has no param",
        ),
        (lambda: kd.StillingerWeber(elements="Si"), r"elements: expected names by species, such as .*, got 'Si'"),
        (
            lambda: two(example(kd.EmbeddedAtom), species=["Cu", "Ag"]),
            r"eam: species 'Ag' has no parameters in \S*Cu_zhou2004.eam.alloy, which has Cu",
        ),
    ],
)
def test_parameters_that_make_no_sense_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without pipes")
@pytest.mark.parametrize("name", ["a.sw", "a.tersoff", "a.eam.alloy"])
def test_a_file_of_a_potential_is_a_regular_file(tmp_path, monkeypatch, name):
    """A pipe would wait for ever, and a device may have no end."""
    monkeypatch.chdir(tmp_path)
    make = {"a.sw": lambda: kd.StillingerWeber(file=name), "a.tersoff": lambda: kd.Tersoff(file=name)}
    for what, place in [("pipe", lambda: os.mkfifo(name)), ("device", lambda: os.symlink("/dev/zero", name))]:
        place()
        with pytest.raises(InputError, match=rf": file: {name}: is a {what}, not a file of a potential"):
            make.get(name, lambda: kd.EmbeddedAtom(name))()
        os.remove(name)


def test_a_file_that_is_no_potential_is_refused(tmp_path):
    (tmp_path / "a.eam.alloy").write_text("one\ntwo\nthree\nfour\n")
    with pytest.raises(InputError, match=r"eam: file: \S*a.eam.alloy: no potential of the form eam/alloy: "):
        kd.EmbeddedAtom(str(tmp_path / "a.eam.alloy"))
    cut = written(tmp_path / "a.eam.fs", copper_tables(20), ("Cu",), "fs")
    (tmp_path / "a.eam.fs").write_text((tmp_path / "a.eam.fs").read_text()[:-40])
    with pytest.raises(InputError, match=r"no potential of the form eam/fs: the file ends too early"):
        kd.EmbeddedAtom(cut)
    (tmp_path / "a.sw").write_text("Si Si Si 1 2 3\n")
    with pytest.raises(InputError, match=r"a.sw: expected entries of three elements and 11 numbers, got 6 words"):
        kd.StillingerWeber(file=str(tmp_path / "a.sw"))


def test_numbers_that_a_line_has_more_than_its_table_are_left_out(tmp_path):
    """As in NiO.eam.fs, whose lines end with numbers that belong to no table."""
    file = written(tmp_path / "a.eam.fs", copper_tables(20), ("Cu", "Ag"), "fs")
    lines = (tmp_path / "a.eam.fs").read_text().splitlines()
    (tmp_path / "b.eam.fs").write_text("\n".join([*lines[:-1], f"{lines[-1]} 7.0 8.0  # more"]))
    np.testing.assert_array_equal(
        kd.EmbeddedAtom(file).potential.rphi, kd.EmbeddedAtom(str(tmp_path / "b.eam.fs")).potential.rphi
    )


def test_species_may_have_other_names_than_in_the_parameters(tmp_path):
    entries = {key.replace("Si", "Si(D)"): each for key, each in TERSOFFS.items()}
    system = particles(["Si", "C"], None, kd.Tersoff(TERSOFFS))
    named = system.with_forces([kd.Tersoff(entries, elements={"Si": "Si(D)"})])
    np.testing.assert_array_equal(kd.Simulation(named, dt=0.001).forces(), kd.Simulation(system, dt=0.001).forces())
    (tmp_path / "named.toml").write_text(named.to_toml())
    assert kd.load(str(tmp_path / "named.toml")).forces == named.forces


def test_triples_that_differ_by_their_digits_alone_are_taken(tmp_path):
    """As in CdTeZnSeHgS0.sw: the product of lambda and epsilon counts, to the file's digits."""
    one = WEBERS["Si-Si-Xx"]
    rounded = one | {"lambda_": one["lambda_"] * 2, "epsilon": one["epsilon"] / 2 * (1 + 3e-8)}
    system = particles(["Si", "Xx"], None, kd.StillingerWeber(WEBERS))
    changed = system.with_forces([kd.StillingerWeber(WEBERS | {"Si-Si-Xx": rounded})])
    near, exact = (kd.Simulation(each, dt=0.001).forces() for each in (changed, system))
    np.testing.assert_allclose(near, exact, atol=1e-7 * np.abs(exact).max())
    with pytest.raises(InputError, match=r"entries Si-Si-Xx and Si-Xx-Si differ in lambda_ times epsilon or"):
        kd.Simulation(system.with_forces([kd.StillingerWeber(WEBERS | {"Si-Si-Xx": one | {"lambda_": 1.0}})]), dt=0.001)


def test_a_header_that_its_file_cannot_fulfil_and_a_density_of_nan_are_refused(tmp_path):
    file = written(tmp_path / "a.eam.he", below_zero(copper_tables(20)), ("Cu",), "he")
    lines = (tmp_path / "a.eam.he").read_text().split("\n")
    n, drho, m, dr, cutoff, highest = lines[4].split()
    for header, message in (
        (f"{10**12} {drho} {m} {dr} {cutoff} {highest}", "1000000000000 and 21 points, more than a file of this size"),
        (f"{n} {drho} {m} {dr} {cutoff} nan", "expected tables of five finite numbers or more"),
    ):
        (tmp_path / "a.eam.he").write_text("\n".join([*lines[:4], header, *lines[5:]]))
        with pytest.raises(InputError, match=message):
            kd.EmbeddedAtom(file)


def test_a_default_set_is_named():
    assert str(kd.Tersoff()).startswith("Tersoff(silicon of Tersoff 1988")
    assert "Si(B) or T2" in str(kd.Tersoff())
    assert "Stillinger & Weber 1985" in str(kd.StillingerWeber())
    entries = {"Si-Si-Si": {**kd.Tersoff().table["Si-Si-Si"], "D": 0.1}}
    assert str(kd.Tersoff(entries)).startswith("Tersoff(entries={'Si-Si-Si': {")
