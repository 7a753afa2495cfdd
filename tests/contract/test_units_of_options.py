"""Every option with a dimension takes text with a unit: in Python, in system files and on the command line."""

from __future__ import annotations

import pytest

import kickdrift as kd
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import integrator, parsed, settled
from kickdrift.integrators.option import DT, Option
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.units import EXAMPLES, quantity, unit_system
from kickdrift.systemfile.schema_run import run_defaults

METHODS = list(dict.fromkeys(INTEGRATORS.values()))
CASES = [(method, each) for method in METHODS for each in method.options if each.dimension]
METAL, LJ = unit_system("metal"), unit_system("lj")


def test_each_dimension_of_an_option_occurs() -> None:
    assert {each.dimension for _, each in CASES} >= {"time", "rate", "temperature", "pressure", "compressibility"}


@pytest.mark.parametrize(("method", "option"), CASES, ids=[f"{m.name}-{o.name}" for m, o in CASES])
def test_an_option_takes_text_with_a_unit(method: kd.integrators.Method, option: Option) -> None:
    text = EXAMPLES[option.dimension]
    wanted = quantity(text, option.dimension, METAL)
    needed = {DT.name: 0.001} if option is not DT else {}

    def value(asked: dict[str, object], run: RunDefaults | None = None) -> object:
        return settled(method, needed | asked, run or RunDefaults(), METAL)[option.name]

    assert value({option.name: text}) == wanted
    assert value(dict(integrator(method.name, **{option.name: text}).options)) == wanted
    assert value(parsed([f"{option.name}={text}"], {})) == wanted
    assert run_defaults({option.name: text}, METAL).said()[option.name] == wanted
    with pytest.raises(kd.InputError, match=f"^{option.name}: lj quantities are plain numbers"):
        settled(method, needed | {option.name: text}, RunDefaults(), LJ)
    with pytest.raises(kd.InputError, match=f"^{option.name}: .*such as"):
        value({option.name: "3 angstrom"})
    with pytest.raises(kd.InputError, match=f"^{option.name}: .*such as"):
        integrator(method.name, **{option.name: "3 angstrom"})
    with pytest.raises(kd.InputError, match=f"^{option.name} must be .*, got '300'"):
        value({option.name: "300"})
