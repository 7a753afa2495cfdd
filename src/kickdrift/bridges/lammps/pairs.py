"""Pair styles of LAMMPS as forces: pair laws, charges, embedded atoms, Stillinger-Weber, Tersoff, or LAMMPS' own.

LAMMPS' coul/dsf differs from kickdrift's damped-shifted law by a constant and in pairs that bonds scale, so it stays
LAMMPS' own.

A style without a counterpart becomes a `LammpsForce`, which gives LAMMPS the same commands at every step, and its
factors of pairs along bonds.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.lammps.laws import LENNARD_JONES, STYLES, SWITCHED, PairStyle
from kickdrift.bridges.lammps.reading import Read, span
from kickdrift.errors import InputError
from kickdrift.forces import (
    Coulomb,
    EmbeddedAtom,
    FormulaPair,
    LammpsForce,
    LennardJones,
    ListedPairs,
    StillingerWeber,
    Tersoff,
)
from kickdrift.forces.charges.accuracy import LEAST, MOST, TYPICAL
from kickdrift.forces.external.lammps import PLAIN as PLAIN_TEXT
from kickdrift.forces.external.lammps_library import POTENTIALS, lammps_class
from kickdrift.model.molecules.relatives import Relatives
from kickdrift.model.state import Floats
from kickdrift.text import choices

LONG = "coul/long"
LINEAR = "lj/smooth/linear"  # Lennard-Jones with truncation "force-shift"
MESHES = ("pppm", "pppm/cg", "pppm/stagger")
FORMS = {"tersoff/mod": ".mod", "tersoff/mod/c": ".modc", "tersoff/zbl": ".zbl"}  # ends of names of their files
MANY_BODY = {"sw": StillingerWeber, "tersoff": Tersoff} | dict.fromkeys(FORMS, Tersoff)
EAM = ("eam", "eam/alloy", "eam/fs", "eam/he")
SUFFIXES = ("/opt", "/omp", "/gpu", "/intel", "/kk")
HARMLESS = {"table", "tabinner", "table/disp", "nofdotr", "mix", "shift", "tail"}  # of pair_modify
PLAIN = (1.0, 1.0, 1.0)
MIXING = {"lj/charmm/coul/long": "arithmetic", "lj/gromacs": "geometric"}  # as LAMMPS mixes where nothing is said
CLOSE = 1e-5  # relative, between a number and LAMMPS' six digits of it


class Charges(NamedTuple):
    """What the choice of Ewald's accuracy needs: charges (n,), and the volume; None without charges."""

    charges: Floats | None
    volume: float


class Types(NamedTuple):
    """LAMMPS' types: the species of each type with particles, in the order of the System."""

    species: dict[int, str]
    every: int  # number of all types, those without particles included


class Pairs(NamedTuple):
    """Forces between pairs, and what the topology says of relatives."""

    forces: list[Any]
    factors: tuple[float, float, float] | None


def style_of(read: Read) -> tuple[str, list[str]]:
    """The pair style without the suffix of a package, and its arguments."""
    name, *rest = read.last("pair_style") or ["none"]
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return name, rest


def elements_of(read: Read, count: int) -> list[str]:
    """Element of each type as a many-body style names them; empty for another style."""
    name, _ = style_of(read)
    for words in read.all("pair_coeff"):
        if name in (*MANY_BODY, *EAM[1:]) and words[:2] == ["*", "*"] and len(words) == 3 + count:
            return words[3:]
    return []


def pairs_of(read: Read, types: Types, kinds: NDArray[np.int64], given: Charges, bonds: Any) -> Pairs:
    """The forces of a pair style on particles of these types (n,)."""
    name, arguments = style_of(read)
    factors, listed = _factors(read, bonds)
    own: list[Any] | None = [] if name in ("none", "zero") else None
    if name in EAM or name in MANY_BODY:
        own = _many_body(read, types, name)
    elif name in SWITCHED:
        own = _switched(read, types, name, arguments, given, listed)
    elif name in (LONG, LINEAR) or _style(name) is not None:
        own = _plain(read, types, name, arguments, given, listed)
    if own is None:
        return Pairs([_in_lammps(read, types, given, bool(len(bonds)))], None)
    if listed:
        own.append(_listed(read, kinds, given, listed))
        factors = PLAIN if factors is None else factors
        factors = tuple(0.0 if listed[k] is not None else factor for k, factor in enumerate(factors))
    return Pairs(own, factors)


def _factors(read: Read, bonds: Any) -> tuple[Any, list[Any]]:
    """Factors of pairs one to three bonds apart; and for each kind of relatives with two different factors, its pairs
    and these factors, else None. The list is empty if all factors agree."""
    if not len(bonds):
        return None, []
    lj, coul = (read.told[f"special_{each}"][1:] for each in ("lj", "coul"))
    words = read.last("special_bonds")
    for key in ("angle", "dihedral", "one/five"):
        if key in words and words[words.index(key) + 1 :][:1] == ["yes"]:
            raise InputError(f"special_bonds: {key} yes has no counterpart in kickdrift")
    has = read.arrays.get("q") is not None and np.any(read.arrays["q"])
    listed: list[Any] = [None, None, None]
    for k, (one, other) in enumerate(zip(lj, coul, strict=True)):
        if has and one != other:
            listed[k] = Relatives.of(np.array(bonds))[k], one, other
    factors = None if tuple(lj) == PLAIN and not any(each is not None for each in listed) else tuple(lj)
    return factors, listed if any(each is not None for each in listed) else []


def _listed(read: Read, kinds: NDArray[np.int64], given: Charges, listed: list[Any]) -> ListedPairs:
    """Pairs whose two factors differ, each with its own well and charges."""
    assert given.charges is not None
    epsilon, sigma = (read.arrays[f"pair_{key}"] for key in ("epsilon", "sigma"))
    pairs, depths, lengths, products = [], [], [], []
    for relatives, one, other in filter(None, listed):
        i, j = relatives.T
        pairs += relatives.tolist()
        depths += (one * epsilon[kinds[i], kinds[j]]).tolist()
        lengths += sigma[kinds[i], kinds[j]].tolist()
        products += (other * given.charges[i] * given.charges[j]).tolist()
    return ListedPairs(pairs, depths, lengths, products)


# --- pair laws and charges ---


def _style(name: str) -> PairStyle | None:
    """The row of a pair style, also with charges beside its law; None without one."""
    plain = LENNARD_JONES if name == LINEAR else name.removesuffix(f"/{LONG}")
    row = STYLES.get(plain)
    return row if row is not None and (row.long or plain == name or name == LINEAR) else None


def _plain(
    read: Read, types: Types, name: str, arguments: list[str], given: Charges, listed: list[Any]
) -> list[Any] | None:
    """A pair law and Coulomb's law; None where LAMMPS' own style is needed."""
    modified = _modified(read)
    if not modified.keys() <= HARMLESS or modified.get("shift") == modified.get("tail") == "yes":
        return None
    numbers = [float(each) for each in arguments]
    forces: list[Any] = []
    if (style := _style(name)) is not None:
        own, cutoff = (numbers[:1], numbers[1]) if name == "yukawa" else ([], numbers[0])
        laws = _laws(read, types, style, own, cutoff)
        if laws is None or (listed and (modified.get("shift") == "yes" or style.force is not LennardJones)):
            return None
        truncation = "force-shift" if name == LINEAR else "shift" if modified.get("shift") == "yes" else "cut"
        forces.append(_pair_force(style, laws, truncation, modified.get("tail") == "yes"))
    if name.endswith(LONG) and given.charges is not None:
        forces.append(_coulomb(read, numbers[-1], given))
    return forces


def _switched(
    read: Read, types: Types, name: str, arguments: list[str], given: Charges, listed: list[Any]
) -> list[Any] | None:
    """Lennard-Jones that ends smoothly, by its formula, and Coulomb's law; None where LAMMPS' own style is needed."""
    inner, outer, *rest = (float(each) for each in arguments)
    if listed or not _modified(read).keys() <= HARMLESS - {"shift", "tail"}:
        return None
    rows = {row.types: row.numbers() for row in read.rows("PairIJ")}
    pairs: dict[tuple[str, str], dict[str, Any]] = {}
    for i, j in combinations_with_replacement(sorted(types.species), 2):
        told = rows.get((i, j), [])
        if len(told) != 4:
            return None
        if not read.states(i, j):
            mixed = _mixed(rows[i, i], rows[j, j], _modified(read).get("mix", MIXING[name]))
            if not np.allclose(mixed, told[:2], rtol=CLOSE, atol=0.0):
                return None
            told = [*mixed, *told[2:]]
        own = {"epsilon": told[0], "sigma": told[1] or 1.0, "inner": inner, "outer": outer}
        if not name.endswith(LONG):
            ends = zip(("inner", "outer"), (inner, outer), told[2:], strict=True)
            own |= {key: end if math.isclose(end, each, rel_tol=CLOSE) else each for key, end, each in ends}
        pairs[types.species[i], types.species[j]] = own
    cutoffs = {each["outer"] for each in pairs.values()}
    shared = {key: value for key, value in {"inner": inner, "outer": outer}.items()
              if all(each[key] == value for each in pairs.values())}  # fmt: skip
    tables = {
        pair: {"parameters": {key: value for key, value in each.items() if key not in shared}}
        | ({"cutoff": each["outer"]} if len(cutoffs) > 1 else {})
        for pair, each in pairs.items()
    }
    forces: list[Any] = [FormulaPair(SWITCHED[name], shared, pairs=tables, cutoff=max(cutoffs), truncation="cut")]
    if name.endswith(LONG) and given.charges is not None:
        forces.append(_coulomb(read, rest[0] if rest else outer, given))
    return forces


def _mixed(one: Sequence[float], other: Sequence[float], how: str) -> tuple[float, float]:
    """Epsilon and sigma of two types, as LAMMPS mixes them."""
    (e1, s1), (e2, s2) = one[:2], other[:2]
    if how == "sixthpower":
        sixth = 0.5 * (s1**6 + s2**6)
        return (math.sqrt(e1 * e2) * (s1 * s2) ** 3 / sixth if sixth else 0.0), sixth ** (1.0 / 6.0)
    return math.sqrt(e1 * e2), math.sqrt(s1 * s2) if how == "geometric" else 0.5 * (s1 + s2)


def _modified(read: Read) -> dict[str, str]:
    """Values of pair_modify."""
    found: dict[str, str] = {}
    for words in read.all("pair_modify"):
        found |= dict(zip(words[::2], words[1::2], strict=False))
    return found


def _laws(
    read: Read, types: Types, style: PairStyle, own: list[float], default: float
) -> dict[tuple[str, str], dict[str, float]] | None:
    """Parameters and cutoff of each pair of species; None where LAMMPS tells not all of their digits."""
    rows = {row.types: row.numbers() for row in read.rows("PairIJ")}
    mixed = style.mixes and all(f"pair_{key}" in read.arrays for key in ("epsilon", "sigma"))
    found = {}
    for i, j in combinations_with_replacement(sorted(types.species), 2):
        values = rows.get((i, j), [])
        if mixed:
            well = [float(read.arrays[f"pair_{key}"][i, j]) for key in ("epsilon", "sigma")]
            values = [*well, *values[2:]] if values else [*well, default]
        if len(values) < 2 or not (mixed or read.states(i, j)):
            return None
        *coefficients, end = values
        cutoff = _cutoff(rows, i, j, end, default)
        law = style.parameters(coefficients, cutoff, own)
        if mixed and not (law["epsilon"] and law["sigma"]):
            law |= {"epsilon": 0.0, "sigma": cutoff / 3.0}  # of no effect without a well
        found[types.species[i], types.species[j]] = law | {"cutoff": cutoff}
    return found


def _cutoff(rows: dict[tuple[int, ...], list[float]], i: int, j: int, told: float, default: float) -> float:
    """The cutoff of a pair with all its digits: the style's, or that of two types that LAMMPS mixes."""
    ends = [rows[k, k][-1] for k in (i, j) if (k, k) in rows]
    known = [default]
    if i != j and len(ends) == 2:
        a, b = ends
        known += [math.sqrt(a * b), 0.5 * (a + b), (0.5 * (a**6 + b**6)) ** (1.0 / 6.0)]
    return next((each for each in known if math.isclose(each, told, rel_tol=CLOSE)), told)


def _pair_force(style: PairStyle, laws: dict[tuple[str, str], dict[str, float]], truncation: str, tail: bool) -> Any:
    """The force with these parameters of pairs of species."""
    acting = {pair: law["cutoff"] for pair, law in laws.items() if law.get("epsilon", 1.0)} or {
        pair: law["cutoff"] for pair, law in laws.items()
    }
    cutoff = max(acting.values())
    one = len(set(acting.values())) == 1
    pairs = {
        pair: {key: value for key, value in law.items() if key != "cutoff" or not (one or pair not in acting)}
        for pair, law in laws.items()
    }
    tables: dict[str, Any] = next(iter(pairs.values())) if len(pairs) == 1 else {"pairs": pairs}
    return style.force(**{"cutoff": cutoff, "truncation": truncation, "tail": tail} | tables)


def _coulomb(read: Read, cutoff: float, given: Charges) -> Coulomb:
    """Coulomb's law with LAMMPS' accuracy; the splitting and the mesh are kickdrift's own."""
    dielectric = float((read.last("dielectric") or ["1"])[0])
    solver, *rest = read.last("kspace_style") or ["none"]
    for suffix in SUFFIXES:
        solver = solver.removesuffix(suffix)
    if solver not in ("ewald", *MESHES) or not rest:
        known = choices(["ewald", *MESHES])
        raise InputError(f"kspace_style {solver}: has no counterpart in kickdrift beside {LONG}; it has {known}")
    for words in read.all("kspace_modify"):
        if found := {"slab", "wire", "force"} & set(words):
            raise InputError(f"kspace_modify: {min(found)} has no counterpart in kickdrift")
    method = "ewald" if solver == "ewald" else "pme"
    return Coulomb(method, _accuracy(float(rest[0]), given), cutoff=cutoff, dielectric=dielectric)


def _accuracy(theirs: float, given: Charges) -> float:
    """kickdrift's accuracy, relative to a typical force, of LAMMPS', relative to that of two unit charges at distance
    one."""
    charges = given.charges
    assert charges is not None
    charged = charges[charges != 0]
    typical = TYPICAL * float((charged**2).mean()) * (len(charged) / given.volume) ** (2.0 / 3.0)
    return min(max(theirs / typical, LEAST), MOST)


# --- many-body forces ---


def _many_body(read: Read, types: Types, name: str) -> list[Any] | None:
    """The many-body force; None where LAMMPS' own style is needed."""
    rows = read.all("pair_coeff")
    if len(rows) != 1 or _modified(read):
        return None
    words = rows[0]
    elements = words[3:] if words[:2] == ["*", "*"] else []
    if name == "eam":
        if types.every != 1 or len(words) != 3:
            return None
        force: Any = EmbeddedAtom(potential(read, words[2]))
        elements = list(force.known)
    elif len(elements) != types.every or "NULL" in elements or not words[2].strip("\"'").endswith(FORMS.get(name, "")):
        return None
    else:
        force = (
            EmbeddedAtom(potential(read, words[2])) if name in EAM else MANY_BODY[name](file=potential(read, words[2]))
        )
    called = {species: elements[k - 1] for k, species in types.species.items() if species != elements[k - 1]}
    if not called:
        return [force]
    if isinstance(force, EmbeddedAtom):
        return [EmbeddedAtom(force.file, elements=called)]
    return [type(force)(force.table, elements=called)]


def potential(read: Read, name: str) -> str:
    """Path of a file of a potential, in the input's folder or among those of LAMMPS."""
    lammps_class()  # names LAMMPS' folder
    found = next((path for path in _places(read.folder, name.strip("\"'")) if path.is_file()), None)
    if found is None:
        raise InputError(f"pair_coeff: {name}: no such file, and LAMMPS has none of this name")
    return str(found)


def _places(folder: Path, name: str) -> Iterator[Path]:
    yield folder / name
    for place in os.environ.get(POTENTIALS, "").split(os.pathsep):
        if place:
            yield Path(place) / Path(name).name


# --- LAMMPS' own styles ---


def _in_lammps(read: Read, types: Types, given: Charges, bonded: bool) -> LammpsForce:
    """The pair style in LAMMPS, whose types are the System's species in their order."""
    style = " ".join(read.last("pair_style"))
    rows = [*read.all("pair_coeff"), *_data_rows(read)]
    commands = [f"{word} {' '.join(words)}" for word in ("pair_modify", "kspace_style", "kspace_modify", "dielectric")
                for words in read.all(word)]  # fmt: skip
    if bonded:
        lj, coul = (" ".join(f"{float(each)!r}" for each in read.told[f"special_{key}"][1:]) for key in ("lj", "coul"))
        commands.append(f"special_bonds lj {lj} coul {coul}")
    coefficients = [" ".join(_found(read.folder, words)) for row in rows for words in renumbered(row, types)]
    zeros = given.charges is None and "q" in read.arrays  # a style of charges works without them
    return LammpsForce(style, coefficients or "* *", commands, "charge" if zeros else None)


def _found(folder: Path, words: Sequence[str]) -> Iterator[str]:
    """The words of a line, in which files beside the input have their whole path, unless that is more than a word."""
    for word in words:
        path = str((folder / word).resolve())
        whole = folder != Path.cwd() and (folder / word).is_file() and (PLAIN_TEXT - {" "}).issuperset(path)
        yield path if whole else word


def _data_rows(read: Read) -> Iterator[list[str]]:
    for row in read.rows("Pair"):
        if not read.all("pair_coeff"):
            yield [str(row.types[0]), str(row.types[0]), *row.values]


def renumbered(words: Sequence[str], types: Types) -> Iterator[list[str]]:
    """Lines of coefficients whose types are those with particles, in the order of the System's species."""
    new = {old: k for k, old in enumerate(types.species, 1)}
    first, second, *rest = words
    if first == second == "*":
        names = rest[-types.every :]
        if len(rest) > types.every and not any(_is_number(each) for each in names):
            rest = [*rest[: -types.every], *(names[old - 1] for old in new)]
        yield ["*", "*", *rest]
        return
    done = set()
    for one in span(first, types.every):
        for other in span(second, types.every):
            if one in new and other in new and (one <= other or first == second):
                pair = tuple(sorted((new[one], new[other])))
                if pair not in done:
                    done.add(pair)
                    yield [*map(str, pair), *rest]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
