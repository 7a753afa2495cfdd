"""What goes with what: forces and boxes down; methods, pressures, precisions and programs across.

    python -m docs.studies.what_composes [--page docs/what-composes.md]

The tables come from the registries. A cell is "yes" if kickdrift takes the request, else the reason in a few words. The
words are those of ``REASONS``, which finds them by the text of the refusal. `tests/contract/test_what_composes.py`
compares the page with the registries, and runs each cell that says yes.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.engines.fields import IN_LAMMPS, IN_OPENMM
from kickdrift.engines.job import Job
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import COUPLING, Options
from kickdrift.integrators.own.registration import REGISTERED
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.docs_tables import deliver, outputs, table
from kickdrift_validation.example_forces import charges, crystal, example, topology

BEGIN, END = "<!-- what_composes.py writes from here -->", "<!-- what_composes.py: to here -->"
BOXES = ("open", "slab", "periodic", "leaning", "plane")
YES = "yes"
REASONS = {  # words by the text of a refusal
    r"needs open space|open space, but": "has no periodic images",
    r"needs a box that is periodic along three axes": "it sums over all images",
    r"a wall needs an open side": "the box has no open side",
    r"integrates a force, and": "a bounce is no force",
    r"frame is periodic along y": "the frame shears across x",
    r"semi-isotropic needs three dimensions": "a plane has two edges",
    r"in three dimensions|needs three dimensions": "three dimensions alone",
    r"depends on velocity": "the force depends on velocity",
    r"out of the system's two dimensions": "it pushes out of planes",
    "leapfrog-block: needs one force": "gravity by a tree alone",
    "leapfrog-block: needs a softening": "a softening sets the steps",
    r"needs one force 'hill'": "Hill's frame alone",
    r"needs one event 'collision'": "hard spheres alone",
    r"needs one force 'gravity'": "gravity alone",
    r"needs the time derivative": "the force has no time derivative",
    r"takes only pair forces and gravity": "pairs and gravity alone",
    r"needs the Jacobian of": "too many unknowns for a Jacobian",
    r"keeps no constraints": "the method keeps no constraints",
    r"only a native run keeps": "the program gets no constraints",
    r"a heat bath makes no sense": "gravity has no equilibrium",
    r"which has no volume": "open space has no volume",
    r"does not scale with the box": "the force has no virial",
    r"needs a rectangular box": "a leaning box keeps its shape",
    r"returns its virial as one number|give only their whole virial": "the virial is one number",
    r"has unknowns beside the bodies|beside: takes neither mixed": "the force has unknowns",
    r"takes neither mixed precision nor a barostat": "spins turn in open space",
    r"mixed needs pair forces": "no pairs to sum",
    r"takes no mixed precision": "tables need addresses of 64 bits",
    r"(ASE|LAMMPS|OpenMM|rebound) (takes|has no)|rebound: |force '.*': ": "the program lacks this force",
    r"coulomb: method .* possible are": "the program lacks this method",
    r"the device takes": "the program lacks this force",
    r"the device has no bonds": "the program lacks bonds",
    r"cannot use a leaning box|two dimensions|periodic along|perpendicular edges": "the program lacks this box",
}  # fmt: skip
VARIANTS = {  # further rows beside that of a force: parameters of the force, and whether pairs of particles are rigid
    "coulomb by pme": ({"method": "pme", "alpha": None, "accuracy": 1e-3}, False),
    "lennard-jones in rigid molecules": ({}, True),
}
FAMILIES = {"splitting": "velocity-verlet", "Kepler splitting": "wisdom-holman", "Runge-Kutta": "dormand-prince45"}
NAMED = {"heat bath": "csvr", "multiple time steps": "respa"}  # other kinds of splittings
OPTIONS = {"temperature": 1.0, "friction": 1.0, "tau": 0.5, "collision_rate": 1.0}
PRESSED = {"temperature": 1.0, "tau": 0.5, "pressure": 0.1, "pressure_tau": 0.5}
SOFT = PRESSED | {"compressibility": 0.1}


def forces() -> list[str]:
    """Names of the forces that ship, with their variants."""
    named = [name for name, cls in FORCES.items() if cls.__module__.startswith("kickdrift.")]
    return [*named, *VARIANTS]


def class_of(name: str) -> Any:
    """Class of the force of a row."""
    return FORCES[name.split()[0]]


def system_of(name: str, box: str) -> kd.System:
    """Some particles under one force of this name in a box. Raises InputError if the force does not take the box."""
    flat = {"amplitude": (0.3, 0.1, 0.0), "normal": (1.0, 0.0, 0.0)} if box == "plane" else {}
    own, rigid = VARIANTS.get(name, ({}, False))
    force = example(class_of(name), **{"cutoff": 1.5, "G": 1e-4} | flat | own)
    species, units, masses = ["A"], "nbody", np.where(np.arange(64) == 0, 1000.0, 1.0)
    x, edges = lattice("sc", 64, 0.9)
    rng = np.random.default_rng(3)
    if box == "plane":
        x = np.indices((8, 8)).reshape(2, -1).T * 1.05
        edges = (8.4, 8.4)
    if isinstance(force, ManyBodyForce):
        start = crystal(force, few=box == "open")
        species, units, masses = list(start.species), "metal", start.state.masses
        x, edges = start.state.positions, start.box.lengths or edges
        x, edges = (x[:, :2], edges[:2]) if box == "plane" else (x, edges)
    matrix = np.diag(edges)
    if box == "leaning":
        matrix[1, 0] = 0.25 * matrix[0, 0]
        x = x + (x[:, 1:2] / matrix[1, 1]) * matrix[1] * [1.0, 0.0, 0.0]
    x = x + rng.uniform(-0.05, 0.05, x.shape)
    v = rng.normal(0.0, 1.0 / np.sqrt(masses)[:, None], x.shape)
    v -= masses @ v / masses.sum()
    lists = topology(force)
    edges_of = {"open": None, "slab": kd.Box(matrix=matrix, periodic=(True, True, False))}
    ions = charges(force, len(x))
    if name in VARIANTS and ions is not None:
        ions = ions - ions.mean()  # sums over all images take no net charge of a slab
    made = kd.System(
        x, v, masses, edges_of.get(box, matrix), [force], units, species=species * len(x), topology=lists,
        dimensions=2 if box == "plane" else 3, charges=ions,
        constraints=[kd.Constraint(rigid=np.arange(len(x)).reshape(-1, 2).tolist())] if rigid else None,
    )  # fmt: skip
    if box == "plane" and lists is not None:  # whether bonds push particles out of it
        kd.Simulation(made, "velocity-verlet", 0.001).energy()
    return made


def usual(name: str) -> kd.System:
    """The force where it is at home: in a periodic box if it takes one, else in open space. Bonded forces have pairs
    beside them, as have the fields that other programs take, and forces around a central body have gravity."""
    try:
        system = system_of(name, "periodic")
    except InputError:
        system = system_of(name, "open")
    if ".around." in class_of(name).__module__:
        return system.with_forces(*system.forces, kd.Gravity(G=1e-4))
    if system.topology is not None or class_of(name) in {*IN_LAMMPS, *IN_OPENMM}:
        return system.with_forces(*system.forces, kd.LennardJones(cutoff=1.5))
    return system


def methods() -> dict[str, str]:
    """One method of each family in the registry, and of each further kind."""
    found = {}
    for name, method in INTEGRATORS.items():
        if name in REGISTERED:  # a user's own
            continue
        found.setdefault(method.family, FAMILIES.get(method.family, name))
    return found | NAMED


def made(method: str, **options: Any) -> Callable[[kd.System], kd.Simulation]:
    """A cell that runs this method."""
    row = INTEGRATORS[method]
    own = {each.name: OPTIONS[each.name] for each in row.declared if each.name in OPTIONS}
    step = {"dt": 0.001} if row.needs_dt else {}
    return lambda system: kd.Simulation(system, method, **step, **own | options)


def refused_by(engine: str) -> Callable[[kd.System], None]:
    """A cell that asks a program, without a need to have the program."""
    row = ENGINES[engine]
    name = "velocity-verlet" if "velocity-verlet" in row.motions else next(iter(row.motions))

    def ask(system: kd.System) -> None:
        if reason := row.refusal(Job(system, INTEGRATORS[name], name, Options(dt=0.001))):
            raise InputError(reason)

    return ask


def columns() -> dict[str, dict[str, Callable[[kd.System], Any]]]:
    """The cells of each table but the first, by its heading and the name of the column."""
    return {
        "Forces and methods": {family: made(name) for family, name in methods().items()},
        "Forces and constant pressure": {
            "c-rescale, isotropic": made("csvr", **SOFT),
            "c-rescale, per-axis": made("csvr", **SOFT, coupling="per-axis"),
            "mtk, full": made("nose-hoover", **PRESSED, barostat="mtk", coupling="full"),
            "monte-carlo, isotropic": made(
                "csvr", **{key: value for key, value in SOFT.items() if key != "pressure_tau"}, barostat="monte-carlo"
            ),
        },
        "Forces, precision and programs": {"mixed precision": made("velocity-verlet", precision="mixed"), **programs()},
    }


def programs() -> dict[str, Callable[[kd.System], Any]]:
    """The cells of other programs, by name."""
    return {name: refused_by(name) for name, engine in ENGINES.items() if engine.foreign}


def box_columns() -> dict[str, Callable[[kd.System], Any]]:
    """The cells of the table of boxes."""
    return {each: made("csvr", **SOFT, coupling=each) for each in COUPLING.choices} | programs()


def reason_of(error: InputError) -> str:
    """The words for a refusal. Raises KeyError if ``REASONS`` has none."""
    for text, words in REASONS.items():
        if re.search(text, str(error)):
            return words
    raise KeyError(f"REASONS of what_composes.py has no words for: {error}")


def cell(ask: Callable[[], Any]) -> str:
    """What a cell says."""
    try:
        ask()
    except InputError as error:
        return reason_of(error)
    return YES


def rows_of(found: dict[str, list[str]]) -> list[list[str]]:
    """Rows of a table; forces whose cells are the same share a row."""
    rows: dict[tuple[str, ...], list[str]] = {}
    for name, cells in found.items():
        force, *rest = name.split(maxsplit=1)
        rows.setdefault(tuple(cells), []).append(" ".join([f"`{force}`", *rest]))
    return [[", ".join(names), *cells] for cells, names in rows.items()]


def page() -> str:
    """All tables."""
    names = forces()
    boxes = {name: [cell(lambda name=name, box=box: system_of(name, box)) for box in BOXES] for name in names}
    parts = ["## Forces and boxes", table(["force", *BOXES], rows_of(boxes))]
    at_home = {name: usual(name) for name in names}
    for heading, asked in columns().items():
        found = {
            name: [cell(lambda ask=ask, system=system: ask(system)) for ask in asked.values()]
            for name, system in at_home.items()
        }
        titles = list(asked)
        if heading == "Forces and methods":
            titles = [f"{family}: `{method}`" for family, method in methods().items()]
        parts += [f"## {heading}", table(["force", *titles], rows_of(found))]
    asked = box_columns()
    fluids = {box: [cell(lambda ask=ask, box=box: ask(system_of("lennard-jones", box))) for ask in asked.values()]
              for box in BOXES}  # fmt: skip
    parts += ["## Boxes, constant pressure and programs", table(["box", *asked], rows_of(fluids))]
    return "\n\n".join(parts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    outputs(parser)
    deliver(parser.parse_args(), {}, page(), BEGIN, END)
