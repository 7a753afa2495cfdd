"""A System as an input of LAMMPS with its data file; `kickdrift.bridges.lammps.system` is the way back."""

from __future__ import annotations

import os
import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.kinds import LAMMPS_HEADING, LAMMPS_INPUT
from kickdrift.disk.outputs import checked_target, private_place, settle
from kickdrift.disk.outputs import reason as reason_of
from kickdrift.engines import rigid
from kickdrift.engines.fields import without
from kickdrift.engines.forces import beside_charges, split, strange
from kickdrift.engines.lammps import APART, modelled, refused
from kickdrift.engines.lammps_model import FIXES, Bonded, Model, Space, acting, bonded_commands, bonded_of, data_of
from kickdrift.engines.special import WHOLE, special_of
from kickdrift.errors import InputError
from kickdrift.forces import LammpsForce
from kickdrift.forces.charges.accuracy import TYPICAL
from kickdrift.forces.charges.coulomb import coulomb_of
from kickdrift.forces.external.lammps import ALONG_BONDS
from kickdrift.forces.external.lammps_data import flags_of
from kickdrift.forces.external.lammps_host import typed_lists
from kickdrift.forces.fields.restraint import Restraint
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.system import System

UNITS = ("lj", "metal", "real")  # unit systems whose numbers LAMMPS and kickdrift share
CONVERTED = {"gromacs": "real"}
LABEL = re.compile(r"[A-Za-z][\w+.-]*")  # a label of a type that no pattern of LAMMPS could mean
LANGEVIN = ("baoab", "obabo", "aboba", "baoa", "gjf")
TAKEN = ("temperature", "friction", "tau", "chain")  # options of baths that the input has
SEED = 4711  # of LAMMPS' random numbers, for a System without a seed
REACH = 3.0  # cutoff of lists where the pair style alone knows its own
SHAKE = 1e-10


class Written(NamedTuple):
    """Files of an input of LAMMPS: the input itself, its data file, and those of potentials."""

    input: Path
    data: Path
    more: tuple[Path, ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """All files."""
        return self.input, self.data, *self.more


def to_lammps(system: System, path: str | os.PathLike[str], overwrite: bool = False) -> Written:
    """Write the files; see `System.to_lammps`."""
    given = Path(path)
    target = given / f"in.{_plain(system.name)}" if given.is_dir() else given
    name = _plain(target.name.removeprefix("in.") if target.name.startswith("in.") else target.stem)
    if target.name == f"{name}.data":
        raise InputError(f"to_lammps: {target}: is the name of the data file beside the input; take in.{name}")
    if system.units.name in CONVERTED:
        system = system.in_units(CONVERTED[system.units.name])
    if reason := _refusal(system):
        raise InputError(f"to_lammps: {reason}")
    model = _model(system)
    left = _left_out(system)
    checked_target(target, LAMMPS_INPUT, overwrite)
    try:
        with private_place(target) as part:
            data = part.with_name(f"{name}.data")
            with data.open("w", encoding="utf-8") as file:
                space = _write_data(system, model, file)
            part.write_text("\n".join([*_lines(system, model, space, data), ""]), encoding="utf-8")
            made = sorted(each for each in part.parent.iterdir() if each not in (part, data))
            for each in (*made, data):
                checked_target(target.with_name(each.name), LAMMPS_INPUT, overwrite)
            for each in (*made, data, part):
                settle(each, target.with_name(each.name), LAMMPS_INPUT, overwrite=overwrite)
    except OSError as error:
        raise InputError(f"to_lammps: {target}: cannot be written: {reason_of(error)}") from None
    more = tuple(target.with_name(each.name) for each in made)
    if left:
        warnings.warn(f"to_lammps: left out: {', '.join(left)}", UserWarning, stacklevel=3)
    return Written(target, target.with_name(data.name), more)


def _plain(name: str) -> str:
    """A name that is one word of an input."""
    return re.sub(r"[^\w.+-]", "_", name) or "system"


def _own(system: System) -> LammpsForce | None:
    """The System's force by LAMMPS' own pair style, or None."""
    return next((force for force in system.forces if isinstance(force, LammpsForce)), None)


def _along(own: LammpsForce) -> str:
    """The force's first command of bonds, angles and so on; "" without one."""
    return next((word for line in own.commands if (word := line.split()[0]) in ALONG_BONDS), "")


def _alone(system: System) -> bool:
    """Whether no force of the System acts between pairs of free particles."""
    inner = without(system, APART)
    return beside_charges(inner) is None and coulomb_of(inner) is None


def _refusal(system: System) -> str | None:
    """Reason why LAMMPS cannot have the System, or None."""
    if system.units.name not in UNITS:
        return f"units {system.units.name!r}: expected {', '.join((*UNITS, *CONVERTED))}"
    if system.virtual_sites is not None:
        return "virtual sites: LAMMPS has none in general; its styles of tip4p place their own"
    if any(event.kind == "collision" for event in system.events):
        return "event 'collision': LAMMPS' particles would pass through each other"
    if system.fixed is not None:
        return "fixed particles: the input would move them; hold them there by fix setforce"
    if (system.state.masses <= 0).any():
        return f"{system.body(int(np.argmin(system.state.masses)))} has no mass, and LAMMPS needs one"
    if any(isinstance(force, Restraint) for force in system.forces):
        return "position restraints: LAMMPS takes the places of its own start; use fix spring/self there"
    if (own := _own(system)) is not None:
        if len(np.unique(np.column_stack([system.species_index, system.state.masses]), axis=0)) > len(system.species):
            return "force 'lammps': its types are the species, and particles of one species differ in mass"
        system = system.under([force for force in system.forces if force is not own])
        if not _alone(system):
            return "force 'lammps': LAMMPS takes one pair style, and the system has another pair force"
        if (along := _along(own)) and (split(system)[1] or system.constraints is not None):
            return f"force 'lammps': {along}: its types are the topology's, and the other forces along bonds differ"
    if not _alone(system):
        return refused(system) or rigid.refusal(system)
    special = special_of(system, None)
    return strange(system, "LAMMPS") or (special if isinstance(special, str) else None) or rigid.refusal(system)


def _model(system: System) -> Model:
    """The System in LAMMPS' terms and in true units."""
    run, masses, own = system.run, system.state.masses, _own(system)
    dt, stepping = run.dt or 0.0, _stepping(system)
    if own is None and not _alone(system):
        model = modelled(system, masses, dt, stepping)
        coulomb = coulomb_of(system)
        if coulomb is None or model.ewald is None or system.charges is None:
            return model._replace(dimensions=system.dimensions)
        charged = system.charges[system.charges != 0]
        typical = TYPICAL * float((charged**2).mean()) * (len(charged) / system.volume) ** (2.0 / 3.0)
        return model._replace(ewald=model.ewald._replace(charges=system.charges, accuracy=coulomb.accuracy * typical))
    kinds, which = np.unique(np.column_stack([system.species_index, masses]), axis=0, return_inverse=True)
    pair: tuple[str, ...] = ("pair_style zero 1.0", "pair_coeff * *")
    bonded = None if own is not None and _along(own) else bonded_of(system, None)
    if own is not None:
        rows = [own.pair_coeff] if isinstance(own.pair_coeff, str) else own.pair_coeff
        pair = (f"pair_style {own.pair_style}", *(f"pair_coeff {row}" for row in rows), *own.commands)
        if bonded is None and system.topology is not None:  # the force has the terms of bonds
            names, lists, labels = typed_lists(system.topology)
            factors = " ".join(map(repr, system.topology.factors or WHOLE))
            counts = {kind: len(known) for kind, known in names.items()}
            bonded, pair = Bonded((f"special_bonds lj/coul {factors}",), lists, counts, 0.0), (*labels, *pair)
    return Model(
        system.box, (which.reshape(-1) + 1).astype(np.int32), tuple(kinds[:, 1].tolist()), (), REACH, False, False, dt,
        system.dimensions, stepping, bonded, own=pair,
    )  # fmt: skip


def _stepping(system: System) -> tuple[str, ...]:
    """Commands of the fixes of the System's default method."""
    said = system.run.said()
    name = "baoab" if said.get("integrator") in LANGEVIN else said.get("integrator")
    given: dict[str, Any] = {
        "thermal": said.get("temperature"), "damping": 1.0 / said["friction"] if said.get("friction") else None,
        "tau": said.get("tau"), "chain": said.get("chain", 3), "seed": (system.seed or SEED) % 2**30 + 1,
    }  # fmt: skip
    lines = FIXES.get(str(name), FIXES["velocity-verlet"])
    if any(f"{{{key}!r}}" in line and value is None for key, value in given.items() for line in lines):
        lines = FIXES["velocity-verlet"]
    plane = ("fix plane all enforce2d",) if system.dimensions == 2 else ()
    return (*(line.format(**given) for line in lines), *plane)


def _left_out(system: System) -> list[str]:
    """What the System says of runs and the input does not."""
    said = system.run.said()
    name = said.get("integrator")
    known = name in (None, *LANGEVIN, *FIXES)
    fixes = " ".join(_stepping(system))
    taken = {"integrator", "dt", "steps", "time", "every", "interval", *(TAKEN if "bath" in fixes else ())}
    found = [] if known else [f"integrator {name} (the input has fix nve)"]
    if name in FIXES and name != "velocity-verlet" and "bath" not in fixes:
        found.append(f"integrator {name}, because its temperature or time is not stated (the input has fix nve)")
    found += [f"{key} = {said[key]}" for key in said if key not in taken]
    found += ["[equilibrate]"] if system.equilibration is not None else []
    found += [f"stage {stage.name!r}" for stage in system.stages]
    return found + [f"event {event.kind}" for event in system.events]


def _steps(system: System) -> int:
    """Steps of the System's default run; 0 without one."""
    run = system.run
    return run.steps or (round(run.time / run.dt) if run.time and run.dt else 0)


def _write_data(system: System, model: Model, file: Any) -> Space:
    """Write the data file, and return LAMMPS' box."""
    x = system.state.positions.copy()
    if system.dimensions == 2:
        x[:, 2] = 0.0
    inside = system.box.wrap(x)
    space = Space.of(model, inside)
    bonds = np.zeros((0, 2), np.int64) if system.topology is None else system.topology.bonds
    molecules = molecules_of(bonds, len(system))
    images = np.round(system.box.fractional(x - inside)).astype(np.int64) if system.box.periodic else None
    data = data_of(
        model, space.edges, inside, system.state.velocities,
        heading=f"{LAMMPS_HEADING}: {system.name}, units = {system.units.name}", labels=_labels(system, model),
        molecules=molecules + 1, images=None if images is None else flags_of(images, molecules),
    )._replace(charges=system.charges)  # fmt: skip
    file.writelines(data.lines())
    return space


def _labels(system: System, model: Model) -> list[str]:
    """The species of each type."""
    kinds = np.unique(np.column_stack([model.types, system.species_index]), axis=0)
    return [system.species[k] for k in kinds[:, 1].tolist()]


def _lines(system: System, model: Model, space: Space, data: Path) -> list[str]:
    """The commands of the input."""
    coulomb = coulomb_of(system)
    labels = _labels(system, model)
    plain = len(set(labels)) == len(labels) and all(LABEL.fullmatch(label) for label in labels)
    still = _rigid_types(system, model)
    return [
        f"# LAMMPS input by kickdrift: {system.name}",
        f"units {system.units.name}",
        f"dimension {model.dimensions}",
        f"atom_style {'molecular' if system.charges is None else 'full'}",
        f"boundary {space.boundary}",
        *bonded_commands(model, f"read_data {data.name}"),
        *([f"labelmap atom {' '.join(f'{k} {label}' for k, label in enumerate(labels, 1))}"] if plain else []),
        *acting(model, data.with_name(data.name.removesuffix(".data")), lambda file: file.name),
        *([f"dielectric {coulomb.dielectric!r}"] if coulomb is not None and coulomb.dielectric != 1.0 else []),
        *(f"mass {kind} {mass!r}" for kind, mass in enumerate(model.masses, 1)),
        f"neighbor {model.skin!r} bin",
        "neigh_modify every 1 delay 0 check yes",
        *([f"fix rigid all shake {SHAKE:g} 500 0 {still}"] if still else []),
        *model.fixes,
        *(line for wall in model.walls for line in wall),
        *([f"timestep {system.run.dt!r}"] if system.run.dt else []),
        "thermo 100",
        f"run {_steps(system)}",
    ]


def _rigid_types(system: System, model: Model) -> str:
    """Words of fix shake: the types of rigid bonds and angles."""
    found = []
    for kind in ("bonds", "angles"):
        rows = model.bonded.lists.get(kind) if model.bonded else None
        still = {tuple(item) for items, _ in rigid.rigid_items(system, kind) for item in (items + 1).tolist()}
        if rows is not None and still:
            types = sorted({row[0] for row in rows.tolist() if tuple(row[1:]) in still})
            found.append(" ".join([kind[0], *map(str, types)]))
    return " ".join(found)
