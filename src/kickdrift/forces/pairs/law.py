"""Pair forces from one formula: ``@pair_law`` turns a law U(r) into a force on the cluster list.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.law import Form, check_law, check_slope, force_of_law
from kickdrift.forces.pairs.ends import WITH_TAIL, End, checked_end, either, mixed_end, own_end
from kickdrift.forces.seam.group import Grouped, ListedForce, brief, refuse_massless
from kickdrift.model.checks.values import number
from kickdrift.text import choices, shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

PAIR_LAW = Form("pair_law", ("p", "r2"), "a pair's energy and force must depend on p and r2 alone")
DEFAULT_CUTOFF = 2.5  # in sigma
SMALL_JUMP = 1e-3  # of the force at 0.9 cutoffs


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairForce(ListedForce, Grouped):
    """Parameters of every pair force, besides those of its law.

    Attributes
    ----------
    cutoff : float
        Pairs further apart do not interact; default 2.5 times the largest ``sigma``. Where pairs have cutoffs of their
        own, this is the largest of them. Each name in ``species`` and ``pairs`` is a species of the particles.
    truncation : "cut", "shift" (of the energy), "force-shift", "switch" (four times continuously differentiable) or
        "potential-switch" (twice; the switch of OpenMM, and GROMACS' of that name)
    switch_start : float, optional
        Start of a switch; default 0.8 cutoff.
    tail : bool
        Add the energy and pressure of a uniform fluid beyond the cutoff (Allen & Tildesley 2017, eqs. 2.144-2.146);
        only with truncation "cut" or "potential-switch", whose energies it completes.
    species : {name: {parameter: value}}, optional
        The law's parameters for each species; other pairs follow from ``mixing`` ("lorentz-berthelot": sigma is the
        arithmetic, epsilon the geometric mean). ``cutoff``, ``truncation`` and ``switch_start`` may stand here too;
        a cutoff mixes as sigma does.
    pairs : {(name, name): {parameter: value}}, optional
        Parameters of named pairs, and their ``cutoff``, ``truncation`` and ``switch_start``; they override mixing.
    """

    cutoff: float | None = None
    truncation: str = "shift"
    switch_start: float | None = None
    tail: bool = False
    species: Mapping[str, Mapping[str, Any]] | None = None
    pairs: Mapping[tuple[str, str], Mapping[str, Any]] | None = None
    mixing: str = "lorentz-berthelot"

    Parameters: ClassVar[Any]  # the law's NamedTuple class
    law_keys: ClassVar[tuple[str, ...]]  # what a table of ``species`` or ``pairs`` may say of the law
    name: ClassVar[str]
    on_sites: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]]

    def __post_init__(self) -> None:
        for key in (*self.law_keys, "cutoff", "switch_start"):
            if isinstance(value := getattr(self, key), np.generic | np.ndarray) and np.ndim(value) == 0:
                object.__setattr__(self, key, value.item())  # a float32 would limit the precision of the law
        if self.mixing != "lorentz-berthelot":
            raise InputError(f"{self.name}: mixing {shown(self.mixing)} is not one of lorentz-berthelot")
        if not isinstance(self.tail, bool | np.bool_):
            raise InputError(f"{self.name}: tail must be True or False, got {shown(self.tail)}")
        self._check_tables()
        for where, law in self._laws_given():
            if problem := getattr(law, "problem", ""):
                raise InputError(f"{self.name}{where}: {problem}")
            for key, value in law._asdict().items():
                if not math.isfinite(number(value)) or (self.dimensions.get(key) == "length" and value <= 0):
                    kind = "positive" if self.dimensions.get(key) == "length" else "finite"
                    raise InputError(f"{self.name}: {key}{where} must be a {kind} number, got {shown(value)}")
        if self.cutoff is None:
            object.__setattr__(self, "cutoff", self._largest_cutoff())
        for where, given in self._tables_given():
            if "cutoff" in given:
                checked_end(self.name, where, given["cutoff"], "cut", None)
        end = checked_end(self.name, "", self.cutoff, self.truncation, self.switch_start)
        object.__setattr__(self, "switch_start", end.switch_start)
        for where, given in self._tables_given():
            own = own_end(self.name, where, given, end)
            if own.cutoff > end.cutoff:
                raise InputError(
                    f"{self.name}: cutoff{where} is {own.cutoff:g}, beyond the cutoff {end.cutoff:g} of the force, "
                    "which is the largest of all pairs"
                )
            if self.tail and own.truncation not in WITH_TAIL:
                at = "" if own == end else where
                raise InputError(
                    f'{self.name}: tail = true completes truncation {either(WITH_TAIL)}, not "{own.truncation}"{at}'
                )
            self._check_given(where, self._filled(where, given), own)

    def _check_given(self, where: str, law: Any, end: End) -> None:
        """Refuse a law that has no value at its cutoff, or whose force is not the slope of its energy."""
        check_law(f"{self.name}{where}", law, end.cutoff)
        check_slope(f"{self.name}{where}", law, end.cutoff)

    def __str__(self) -> str:
        return brief(self, "species")

    @property
    def stands_for(self) -> str:  # type: ignore[override]
        """What the force models: its law."""
        return self.name

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """The pairs of species between which the law is not zero everywhere."""
        found = {}
        for a, b in combinations_with_replacement(sorted(system.species), 2):
            law, cutoff = self.pair_law(a, b), self.pair_end(a, b).cutoff
            if any(any(law.law((part * cutoff) ** 2)) for part in (0.3, 0.5, 0.8)):
                found[a, b] = f"pairs {a}-{b}"
        return found

    def cores(self, system: Subject) -> set[str]:
        """Species on which the law acts at all; others, such as hydrogen of water, may come near any particle."""
        return {name for pair in self.acting_on(system) or () for name in pair}

    @property
    def law(self) -> Any:
        """Parameters of the law for one species."""
        return self.Parameters(*(getattr(self, key) for key in self.Parameters._fields))

    @property
    def _is_default(self) -> bool:
        """Whether the force has parameters of its own for all pairs, and all of them are the defaults."""
        return not self._tables_given()[0][0] and bool(self.law._asdict() == self.Parameters._field_defaults)

    @property
    def names(self) -> tuple[str, ...]:
        """Species that ``species`` and ``pairs`` name."""
        return tuple(dict.fromkeys([*(self.species or ()), *(name for pair in self.pairs or () for name in pair)]))

    def among(self, species: Sequence[str]) -> PairForce:
        """This force without the parameters of other species, which change nothing."""
        if set(self.names) <= set(species):
            return self
        kept = {name: each for name, each in (self.species or {}).items() if name in species}
        pairs = {pair: each for pair, each in (self.pairs or {}).items() if set(pair) <= set(species)}
        return dataclasses.replace(self, species=kept or None, pairs=pairs or None)

    def unset(self, system: Subject) -> list[str]:
        """Pairs of species without parameters of their own, where only pairs are named and the rest is default."""
        if not self.pairs or self.species or not self._is_default:
            return []
        every = combinations_with_replacement(system.species, 2)
        return [f"{a}-{b}" for a, b in every if self._given(a, b) is None]

    def law_with(self, where: str, values: Mapping[str, Any]) -> Any:
        """Parameters of the law with these values in place of the force's own; ``where`` says whose they are."""
        return self.law._replace(**values)

    def _check_tables(self) -> None:
        """Refuse ``species`` and ``pairs`` that are not tables of tables."""
        for key, given in (("species", self.species), ("pairs", self.pairs)):
            if given is None:
                continue
            if not isinstance(given, Mapping):
                raise InputError(f"{self.name}: {key}: expected a table, got {shown(given)}")
            for name, values in given.items():
                if key == "pairs" and not (isinstance(name, tuple) and len(name) == 2):
                    raise InputError(
                        f"{self.name}: pairs: expected two names such as {_example(name)}, got {shown(name)}"
                    )
                if not isinstance(values, Mapping):
                    raise InputError(f"{self.name}: {key}[{shown(name)}]: expected a table, got {shown(values)}")

    def _tables_given(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Tables of parameters, each with words that say where it stands; an empty one for the force's own."""
        given: list[tuple[str, Mapping[str, Any]]] = [("", {})] if not self.species else []
        given += [(f" of species {s}", values) for s, values in (self.species or {}).items()]
        return given + [(f" of pair {a}-{b}", values) for (a, b), values in (self.pairs or {}).items()]

    def _laws_given(self) -> list[tuple[str, Any]]:
        return [(where, self._filled(where, given)) for where, given in self._tables_given()]

    def _filled(self, where: str, values: Mapping[str, Any]) -> Any:
        known = (*self.law_keys, *End._fields)
        if unknown := set(values) - set(known):
            raise InputError(
                f"{self.name}: {where.removeprefix(' of ')}: unknown parameter {shown(min(map(str, unknown)))}; "
                f"expected {', '.join(known)}"
            )
        return self.law_with(where, {key: value for key, value in values.items() if key not in End._fields})

    def _largest_cutoff(self) -> float:
        """The largest of the cutoffs that species and pairs have, and of the reaches of the others' laws: 2.5 sigma,
        unless the law says another. The force's own default parameters do not count where all named pairs have
        cutoffs."""
        found, tables = [], self._tables_given()
        if not tables[0][0] and self.pairs:
            own, *tables = tables
            if not (self._is_default and all("cutoff" in each for _, each in tables)):
                tables.append(own)  # last, so that a pair without a cutoff is named first
        for where, given in tables:
            law = self._filled(where, given)
            reach = getattr(law, "reach", DEFAULT_CUTOFF * getattr(law, "sigma", 0.0))
            if "cutoff" in given or reach:
                found.append(given.get("cutoff", reach))
            else:
                raise InputError(f"{self.name}: cutoff{where} is needed")
        return max(found, key=number)

    def _given(self, a: str, b: str) -> Mapping[str, Any] | None:
        """Table of the pair of species a and b, or None."""
        return next((self.pairs[pair] for pair in ((a, b), (b, a)) if self.pairs and pair in self.pairs), None)

    def pair_end(self, a: str, b: str) -> End:
        """Where and how the pair of species a and b ceases to interact."""
        assert self.cutoff is not None
        whole, species = End(self.cutoff, self.truncation, self.switch_start), self.species or {}
        ends = (own_end(self.name, f" of species {name}", species.get(name, {}), whole) for name in (a, b))
        found = own_end(self.name, f" of pair {a}-{b}", self._given(a, b) or {}, mixed_end(*ends))
        if not found.truncation:
            raise InputError(f"{self.name}: pair {a}-{b} is needed: truncations of different kinds have no mean")
        return found

    def ends(self, species: Sequence[str]) -> set[End]:
        """Ends of all pairs of these species: one, unless pairs have cutoffs or truncations of their own."""
        return {self.pair_end(a, b) for a, b in combinations_with_replacement(species, 2)}

    def pair_law(self, a: str, b: str) -> Any:
        """Parameters of the law between species a and b."""
        if (given := self._given(a, b)) is not None:
            return self._filled(f" of pair {a}-{b}", given)
        if not self.species:
            return self.law
        for name in (a, b):
            if name not in self.species:
                raise InputError(f"{self.name}: species {name!r} has no parameters (and no pair {a}-{b} is given)")
        first, second = (self._filled(f" of species {name}", self.species[name])._asdict() for name in (a, b))
        shared = {key for key in getattr(self.Parameters, "shared", ()) if first[key] == second[key]}
        if a != b and not set(first) - shared <= {"epsilon", "sigma"}:
            raise InputError(f"{self.name}: pair {a}-{b} is needed: only epsilon and sigma can be mixed")
        if a != b and first.get("epsilon", 0.0) * second.get("epsilon", 0.0) < 0:
            raise InputError(f"{self.name}: pair {a}-{b} is needed: epsilons of different signs have no geometric mean")
        means = {"sigma": lambda p, q: 0.5 * (p + q), "epsilon": lambda p, q: math.sqrt(p * q)}
        same = shared if a != b else set(first)
        return self.Parameters(**{k: first[k] if k in same else means[k](first[k], second[k]) for k in first})

    def jumps_at_cutoff(self, species: Sequence[str]) -> bool:
        """Tell whether the force between some species jumps at the cutoff: beyond a thousandth of its size at 0.9
        cutoffs. A cutoff in the minimum of the potential makes no jump."""
        for a, b in combinations_with_replacement(species, 2):
            end, law = self.pair_end(a, b), self.pair_law(a, b)
            if end.truncation in ("cut", "shift"):
                near, far = law.law((0.9 * end.cutoff) ** 2)[1], law.law(end.cutoff**2)[1]
                if abs(far) > SMALL_JUMP * abs(near):
                    return True
        return False

    def shortest(self) -> float:
        """Smallest length among the law's parameters (sigma); particles much closer than this overlap."""
        lengths = [
            getattr(law, key)
            for _, law in self._laws_given()
            for key in law._fields
            if self.dimensions.get(key) == "length"
        ]
        return min(lengths, default=0.0)

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support."""
        assert self.cutoff is not None
        if strange := [name for name in self.names if name not in system.species]:
            raise InputError(
                f"{self.name}: no particle is of species {choices(map(repr, strange))}"
                f"{suggestion(strange[0], system.species)} (species: {choices(system.species)})"
            )
        system.box.check_cutoff(self.name, self.cutoff, system.units)
        if self.tail and not math.isfinite(system.volume):
            raise InputError(f"{self.name}: tail corrections need a periodic box")
        refuse_massless(self.name, system, "a pair force")
        if system.topology is not None and (far := system.topology.far_special(system.box, system.state.phase[0])):
            raise InputError(f"{self.name}: {far}")
        for a in system.species:
            for b in system.species:
                check_law(self.name, self.pair_law(a, b), self.pair_end(a, b).cutoff)

    def tail_corrections(self, system: Subject) -> tuple[float, float]:
        """Energy and virial from beyond the cutoff, by quadrature of the law for a uniform fluid."""
        if not self.tail:
            return 0.0, 0.0
        assert self.cutoff is not None
        counts = np.bincount(system.species_index, minlength=len(system.species))
        circle, p_u, p_w = (2 * math.pi, 4, 6) if system.dimensions == 3 else (math.pi, 3, 5)
        energy = virial = 0.0
        for a, n_a in zip(system.species, counts, strict=True):
            for b, n_b in zip(system.species, counts, strict=True):
                p, (cutoff, _, start) = self.pair_law(a, b), self.pair_end(a, b)
                density = circle * n_a * n_b / system.volume
                try:
                    if start is None:
                        u_part, w_part = (_over_tail(p, k, power, cutoff) for k, power in ((0, p_u), (1, p_w)))
                    else:
                        u_part = _over_tail(p, 0, p_u, cutoff, start)
                        w_part = system.dimensions * u_part  # integrated by parts; the energy has no jump
                except ArithmeticError:
                    raise InputError(f"{self.name}: the tail beyond the cutoff does not converge for {a}-{b}") from None
                energy += density * u_part
                virial += density * w_part
        return energy, virial

    def bind(self, system: Subject, threads: int = 1, mixed: bool = False) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body, with ``mixed`` in mixed precision."""
        from kickdrift.forces.pairs.binding import bind

        return bind(self, system, threads, mixed)


def _over_tail(law: Any, part: int, power: int, cutoff: float, start: float | None = None) -> float:
    """Integral of an energy (part 0) or a force over r (part 1) over u = 1 / r, from 0 to 1 / cutoff; ArithmeticError
    if the integral does not converge. If a potential-switch begins at ``start``, with what it takes away up to the
    cutoff. With ``full_output``, SciPy returns its doubts and changes no warnings."""
    from scipy.integrate import quad

    def missing(r: float) -> float:
        if start is None or r >= cutoff:
            return 1.0
        u = (r - start) / (cutoff - start)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

    far, points = 1 / (cutoff if start is None else start), None if start is None else [1 / cutoff]
    found = quad(
        lambda u: missing(1 / u) * law.law(u**-2)[part] / u**power, 0, far, epsabs=0, epsrel=1e-12, points=points,
        full_output=1,
    )  # fmt: skip
    if len(found) > 3:
        raise ArithmeticError(found[3])
    return float(found[0])


def _example(name: Any) -> str:
    """Example of a key of ``pairs``, with the user's names if a text such as "A-B" gives them."""
    parts = re.split(r"[-,:/ ]+", name.strip()) if isinstance(name, str) else []
    return repr(tuple(parts)) if len(parts) == 2 and all(parts) else "('A', 'B')"


def pair_law(cls: type) -> Any:
    """Make a force of a NamedTuple class whose ``law(p, r2)`` returns energy and force over r, -U'(r) / r.

    The class's fields are the law's parameters, the force has them and those of ``PairForce``. ``law`` is compiled for
    SIMD lanes: ``+ - * / **``, comparisons, ``math.sqrt``, ``math.exp`` and ``math.log`` work. An
    optional ``dimensions`` names the kind of each parameter ("length", "energy", …) for system files with units.

    A law must not keep state between calls, such as a counter or a random number: its code is compiled once and called
    for many pairs in any order. The force is registered under the class's name in lower case, with hyphens:
    "morse" for ``Morse``. System files and ``resume`` find the force by this name (see ``register_force``). In system
    files, a later law of the same name replaces an earlier one.

    Raises
    ------
    InputError
        If the code of the law shows that the law keeps state, or if the name belongs to a force that ships. The laws
        by name, such as ``Mie`` and ``Yukawa``, give way: your law of that name stands for it in this process.
    """
    return force_of_law(cls, PairForce, PAIR_LAW, {}, {"cutoff": "length", "switch_start": "length"})
