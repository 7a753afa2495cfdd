"""Every option and every parameter of a force with a dimension takes text with a unit, in Python as in system files."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces import FORCES
from kickdrift.forces.seam.group import Grouped
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import integrator, parsed, settled
from kickdrift.integrators.options import DT, Option
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.units.quantities import EXAMPLES, quantity, unit_system
from kickdrift.systemfile.schema_run import run_defaults
from kickdrift_validation.example_forces import example

METHODS = list(dict.fromkeys(INTEGRATORS.values()))
CASES = [(method, each) for method in METHODS for each in method.options if each.dimension]
METAL, LJ = unit_system("metal"), unit_system("lj")


def test_each_dimension_of_an_option_occurs() -> None:
    assert {each.dimension for _, each in CASES} >= {"time", "rate", "temperature", "pressure", "compressibility"}


@pytest.mark.parametrize(("method", "option"), CASES, ids=[f"{m.name}-{o.name}" for m, o in CASES])
def test_an_option_takes_text_with_a_unit(method: kd.integrators.Method, option: Option) -> None:
    example, many = EXAMPLES[option.dimension], option.count > 1
    found = quantity(example, option.dimension, METAL)
    wanted = (found,) * option.count if many else found
    text, wrong = ([each] * option.count if many else each for each in (example, "3 angstrom"))
    typed = ",".join([example] * option.count)
    needed = {DT.name: 0.001} if option is not DT else {}

    def value(asked: dict[str, object], run: RunDefaults | None = None) -> object:
        return settled(method, needed | asked, run or RunDefaults(), METAL)[option.name]

    assert value({option.name: text}) == wanted
    assert value(dict(integrator(method.name, **{option.name: text}).options)) == wanted
    assert value(parsed([f"{option.name}={typed}"], {})) == wanted
    stored = run_defaults({option.name: text}, METAL).said()[option.name]
    assert (tuple(stored) if many else stored) == wanted
    with pytest.raises(kd.InputError, match=f"^{option.name}: lj quantities are plain numbers"):
        settled(method, needed | {option.name: text}, RunDefaults(), LJ)
    with pytest.raises(kd.InputError, match=f"^{option.name}: .*such as"):
        value({option.name: wrong})
    with pytest.raises(kd.InputError, match=f"^{option.name}: .*such as"):
        integrator(method.name, **{option.name: wrong})
    with pytest.raises(kd.InputError, match=f"^{option.name} must be .*, got '300'"):
        value({option.name: "300"})


OWN = [cls for cls in FORCES.values() if cls.__module__.startswith("kickdrift.")]
WITH_DIMENSIONS = [cls for cls in OWN if getattr(cls, "dimensions", None) and issubclass(cls, Grouped)]


def as_text(value: object, unit: str) -> object:
    """Numbers of a parameter as texts with this unit."""
    if isinstance(value, tuple):
        return tuple(as_text(each, unit) for each in value)
    return f"{value!r} {unit}" if isinstance(value, float) else value


@pytest.mark.parametrize("cls", WITH_DIMENSIONS, ids=lambda cls: cls.name)
def test_a_parameter_of_a_force_takes_text_with_a_unit(cls: type) -> None:
    """The System that takes the force converts, exactly as its system file does."""
    force = example(cls)
    texts = {
        key: as_text(value, METAL.unit(cls.dimensions[key]))
        for key, value in vars(force).items()
        if key in cls.dimensions and METAL.unit(cls.dimensions[key]) and as_text(value, "") != value
    }
    if not texts:
        pytest.skip("the example gives no such parameter")
    given = cls(**{**{key: getattr(force, key) for key in inspect.signature(cls).parameters}, **texts})
    made = given.in_units(METAL)
    assert type(made) is cls
    for key in texts:
        np.testing.assert_allclose(getattr(made, key), getattr(force, key), rtol=1e-14)
    with pytest.raises(kd.InputError, match=rf"^{cls.name}: \w+: lj quantities are plain numbers"):
        cls(**{**{key: getattr(force, key) for key in inspect.signature(cls).parameters}, **texts}).in_units(LJ)


def test_a_system_converts_the_texts_of_its_forces() -> None:
    argon = kd.load("argon-864")
    given = kd.LennardJones(epsilon="120 K", sigma="3.4 angstrom", cutoff="0.765 nm")
    assert (
        argon.with_forces(given).forces
        == argon.with_forces(kd.LennardJones(0.010340799914574214, 3.4, cutoff=7.65)).forces
    )
    kinds = kd.LennardJones(
        species={"Ar": {"epsilon": "120 K", "sigma": 3.4}}, pairs={("Ar", "Ar"): {"sigma": "0.3 nm"}}
    )
    (force,) = argon.with_forces(kinds).forces
    assert force.species["Ar"] == {"epsilon": argon.forces[0].epsilon, "sigma": 3.4}
    assert force.pairs == {("Ar", "Ar"): {"sigma": 3.0}}
    with pytest.raises(kd.InputError, match="lennard-jones: epsilon: lj quantities are plain numbers, got '120 K'"):
        kd.System([[0.0, 0.0, 0.0]], forces=[given])
    with pytest.raises(kd.InputError, match=r"lennard-jones: epsilon: expected an energy such as"):
        argon.with_forces(kd.LennardJones(epsilon="120 m"))
    with pytest.raises(kd.InputError, match=r"has texts with units; give it to kd\.System"):
        given.check(argon)
    with pytest.raises(kd.InputError, match="did you mean 'epsilon'"):
        kd.LennardJones(epsilom="120 K")
