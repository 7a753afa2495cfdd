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
from kickdrift.forces.seam.group import Grouped, ListedForce, brief, refuse_massless
from kickdrift.model.checks.values import number
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

PAIR_LAW = Form("pair_law", ("p", "r2"), "a pair's energy and force must depend on p and r2 alone")
TRUNCATIONS = ("cut", "shift", "force-shift", "switch", "potential-switch")
SWITCHED = TRUNCATIONS[3:]
WITH_TAIL = ("cut", "potential-switch")
SWITCH_START = 0.8  # default start of the switch, as a part of the cutoff
DEFAULT_CUTOFF = 2.5  # in sigma
SMALL_JUMP = 1e-3  # of the force at 0.9 cutoffs
SHORTEST, LONGEST = 1e-100, 1e100  # limits of a cutoff: its sphere's volume stays within the range of float64


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairForce(ListedForce, Grouped):
    """Parameters of every pair force, besides those of its law.

    Attributes
    ----------
    cutoff : float
        Pairs further apart do not interact; default 2.5 times the largest ``sigma``.
    truncation : "cut", "shift" (of the energy), "force-shift", "switch" (four times continuously differentiable) or
        "potential-switch" (twice; the switch of OpenMM, and GROMACS' of that name)
    switch_start : float, optional
        Start of a switch; default 0.8 cutoff.
    tail : bool
        Add the energy and pressure of a uniform fluid beyond the cutoff (Allen & Tildesley 2017, eqs. 2.144-2.146);
        only with truncation "cut" or "potential-switch", whose energies it completes.
    species : {name: {parameter: value}}, optional
        The law's parameters for each species; other pairs follow from ``mixing`` ("lorentz-berthelot": sigma is the
        arithmetic, epsilon the geometric mean).
    pairs : {(name, name): {parameter: value}}, optional
        Parameters of named pairs; they override mixing.
    """

    cutoff: float | None = None
    truncation: str = "shift"
    switch_start: float | None = None
    tail: bool = False
    species: Mapping[str, Mapping[str, float]] | None = None
    pairs: Mapping[tuple[str, str], Mapping[str, float]] | None = None
    mixing: str = "lorentz-berthelot"

    Parameters: ClassVar[Any]  # the law's NamedTuple class
    name: ClassVar[str]
    on_sites: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]]

    def __post_init__(self) -> None:
        for key in (*self.Parameters._fields, "cutoff", "switch_start"):
            if isinstance(value := getattr(self, key), np.generic | np.ndarray) and np.ndim(value) == 0:
                object.__setattr__(self, key, value.item())  # a float32 would limit the precision of the law
        if self.truncation not in TRUNCATIONS:
            raise InputError(f"{self.name}: truncation {shown(self.truncation)} is not one of {', '.join(TRUNCATIONS)}")
        if self.mixing != "lorentz-berthelot":
            raise InputError(f"{self.name}: mixing {shown(self.mixing)} is not one of lorentz-berthelot")
        if not isinstance(self.tail, bool | np.bool_):
            raise InputError(f"{self.name}: tail must be True or False, got {shown(self.tail)}")
        self._check_tables()
        if self.tail and self.truncation not in WITH_TAIL:
            raise InputError(
                f'{self.name}: tail = true completes truncation {_either(WITH_TAIL)}, not "{self.truncation}"'
            )
        for where, law in self._laws_given():
            for key, value in law._asdict().items():
                if not math.isfinite(number(value)) or (self.dimensions.get(key) == "length" and value <= 0):
                    kind = "positive" if self.dimensions.get(key) == "length" else "finite"
                    raise InputError(f"{self.name}: {key}{where} must be a {kind} number, got {shown(value)}")
        if self.cutoff is None:
            sigmas = [getattr(law, "sigma", None) for _, law in self._laws_given()]
            if not all(sigmas):
                raise InputError(f"{self.name}: cutoff is needed")
            object.__setattr__(self, "cutoff", DEFAULT_CUTOFF * max(s for s in sigmas if s))
        assert self.cutoff is not None
        if not (math.isfinite(number(self.cutoff)) and self.cutoff > 0):
            raise InputError(f"{self.name}: cutoff must be a positive length, got {shown(self.cutoff)}")
        if not SHORTEST < self.cutoff < LONGEST:
            raise InputError(
                f"{self.name}: cutoff must be between {SHORTEST:g} and {LONGEST:g}, so that its powers are numbers, "
                f"got {shown(self.cutoff)}"
            )
        if self.truncation in SWITCHED:
            start = SWITCH_START * self.cutoff if self.switch_start is None else self.switch_start
            if not math.isfinite(number(start)):
                raise InputError(f"{self.name}: switch_start must be a length, got {shown(start)}")
            if not 0 < start < self.cutoff:
                raise InputError(
                    f"{self.name}: switch_start must lie between 0 and the cutoff {self.cutoff:g}, got {start:g}"
                )
            object.__setattr__(self, "switch_start", start)
        elif self.switch_start is not None:
            raise InputError(
                f'{self.name}: switch_start goes with truncation {_either(SWITCHED)}, not "{self.truncation}"'
            )
        for where, law in self._laws_given():
            check_law(f"{self.name}{where}", law, self.cutoff)
            check_slope(f"{self.name}{where}", law, self.cutoff)

    def __str__(self) -> str:
        return brief(self, "species")

    @property
    def stands_for(self) -> str:  # type: ignore[override]
        """What the force models: its law."""
        return self.name

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """The pairs of species between which the law is not zero everywhere."""
        assert self.cutoff is not None
        probes = [(part * self.cutoff) ** 2 for part in (0.3, 0.5, 0.8)]
        found = {}
        for a, b in combinations_with_replacement(sorted(system.species), 2):
            law = self.pair_law(a, b)
            if any(any(law.law(r2)) for r2 in probes):
                found[a, b] = f"pairs {a}-{b}"
        return found

    @property
    def law(self) -> Any:
        """Parameters of the law for one species."""
        return self.Parameters(*(getattr(self, key) for key in self.Parameters._fields))

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

    def _laws_given(self) -> list[tuple[str, Any]]:
        given = [("", self.law)] if not self.species else []
        given += [(f" of species {s}", self._filled(s, values)) for s, values in (self.species or {}).items()]
        given += [(f" of pair {a}-{b}", self._filled(f"{a}-{b}", p)) for (a, b), p in (self.pairs or {}).items()]
        return given

    def _filled(self, where: str, values: Mapping[str, float]) -> Any:
        unknown = set(values) - set(self.Parameters._fields)
        if unknown:
            known = ", ".join(self.Parameters._fields)
            raise InputError(
                f"{self.name}: {where}: unknown parameter {shown(min(map(str, unknown)))}; expected {known}"
            )
        return self.law._replace(**values)

    def pair_law(self, a: str, b: str) -> Any:
        """Parameters of the law between species a and b."""
        for pair in ((a, b), (b, a)):
            if self.pairs and pair in self.pairs:
                return self._filled(f"{a}-{b}", self.pairs[pair])
        if not self.species:
            return self.law
        for name in (a, b):
            if name not in self.species:
                raise InputError(f"{self.name}: species {name!r} has no parameters (and no pair {a}-{b} is given)")
        first, second = (self._filled(name, self.species[name])._asdict() for name in (a, b))
        if a != b and not set(first) <= {"epsilon", "sigma"}:
            raise InputError(f"{self.name}: pair {a}-{b} is needed: only epsilon and sigma can be mixed")
        if a != b and first.get("epsilon", 0.0) * second.get("epsilon", 0.0) < 0:
            raise InputError(f"{self.name}: pair {a}-{b} is needed: epsilons of different signs have no geometric mean")
        means = {"sigma": lambda p, q: 0.5 * (p + q), "epsilon": lambda p, q: math.sqrt(p * q)}
        return self.Parameters(**{k: first[k] if a == b else means[k](first[k], second[k]) for k in first})

    def jumps_at_cutoff(self, species: Sequence[str]) -> bool:
        """Tell whether the force between some species jumps at the cutoff: beyond a thousandth of its size at 0.9
        cutoffs. A cutoff in the minimum of the potential makes no jump."""
        if self.truncation not in ("cut", "shift"):
            return False
        assert self.cutoff is not None
        near, far = (0.9 * self.cutoff) ** 2, self.cutoff**2
        laws = [self.pair_law(a, b) for k, a in enumerate(species) for b in species[k:]]
        return any(abs(p.law(far)[1]) > SMALL_JUMP * abs(p.law(near)[1]) for p in laws)

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
        system.box.check_cutoff(self.name, self.cutoff)
        if self.tail and not math.isfinite(system.volume):
            raise InputError(f"{self.name}: tail corrections need a periodic box")
        refuse_massless(self.name, system, "a pair force")
        if system.topology is not None and (far := system.topology.far_special(system.box, system.state.phase[0])):
            raise InputError(f"{self.name}: {far}")
        for a in system.species:
            for b in system.species:
                check_law(self.name, self.pair_law(a, b), self.cutoff)

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
                p = self.pair_law(a, b)
                density = circle * n_a * n_b / system.volume
                try:
                    if self.switch_start is None:
                        u_part, w_part = (_over_tail(p, k, power, self.cutoff) for k, power in ((0, p_u), (1, p_w)))
                    else:
                        u_part = _over_tail(p, 0, p_u, self.cutoff, self.switch_start)
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


def _either(names: Sequence[str]) -> str:
    return " or ".join(f'"{each}"' for each in names)


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
        If the code of the law shows that the law keeps state, or if the name belongs to a force that ships.
    """
    return force_of_law(cls, PairForce, PAIR_LAW, {}, {"cutoff": "length", "switch_start": "length"})
