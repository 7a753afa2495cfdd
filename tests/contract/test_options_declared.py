"""Options of integrators: each declared option is a keyword, a key of [run], an argument -o KEY=VALUE, and recorded."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import as_text, known_options, parsed, takers
from kickdrift.integrators.options import DOUBLE, DT, MIXED, OPTIONS, PRECISION, Option, Options, merged
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.systemfile.reading import loads
from kickdrift.systemfile.schema_run import run_keys
from tests.systems import in_frame, needed, pressed

METHODS = {method.name: method for method in INTEGRATORS.values()}
CASES = [(name, each.name) for name, method in METHODS.items() for each in method.options if each is not DT]
FILE = """
units = "astro"
[particles]
central = {{ body = "Sun", mass = 1.0 }}
elements = [{{ body = "Jupiter", mass = 9.55e-4, a = 5.2, e = 0.048 }}]
[[force]]
type = "gravity"
[run]
integrator = "{name}"
{option}
"""


LIQUID = """
units = "lj"
[particles]
positions = [[0, 0, 0], [1.2, 0, 0], [0, 1.3, 0]]
[box]
lengths = [9, 9, 9]
[[force]]
type = "lennard-jones"
[run]
integrator = "{name}"
{option}
"""


def declared(name: str, key: str) -> Option:
    return next(each for each in METHODS[name].options if each.name == key)


def value_of(option: Option) -> Any:
    """A value other than the default, if there is one; mixed precision needs pair forces."""
    if option.name == PRECISION.name:
        return DOUBLE
    if option.choices:
        return next((choice for choice in reversed(option.choices) if choice != option.default), option.default)
    if option.count > 1:
        return tuple(0.25 * k for k in range(option.count))
    if option.type is bool:
        return not option.default
    return (option.default or 3) - 1 if option.type is int else 0.5 * (option.default or 0.5)


def wrong_value_of(option: Option) -> Any:
    if option.type is bool:
        return "maybe"
    if option.type in (float, int):
        return -12345 if option.above > -math.inf else math.inf
    return "nonsense"


def toml(value: Any) -> str:
    plain = list(value) if isinstance(value, tuple) else value
    return str(value).lower() if isinstance(value, bool) else repr(plain).replace("'", '"')


def from_file(name: str, line: str) -> kd.System:
    system = loads((LIQUID if METHODS[name].bath else FILE).format(name=name, option=line))
    assert isinstance(system, kd.System)
    return in_frame(name, system)


YOUNGER = (  # than 0.1.0
    "temperature", "temperature_to", "friction", "seed", "noise", "pressure", "pressure_to", "barostat", "coupling",
    "pressure_tau", "compressibility", "pressure_every", "stress", "ramp_steps", "allow_gravity", "tau", "chain",
    "splitting", "collision_rate", "substeps", "phi0", "phi1", "pairs", "kernel",
)  # fmt: skip


def step(name: str, but: str = "") -> dict[str, float]:
    given = needed(name) | ({"dt": 0.1} if METHODS[name].needs_dt else {})
    if but in METHODS[name].tunable:
        given |= pressed({but: value_of(declared(name, but))})
    return {key: value for key, value in given.items() if key != but}


@pytest.mark.parametrize(("name", "key"), CASES)
def test_an_option_is_a_keyword_a_key_of_run_and_a_text(name, key):
    option = declared(name, key)
    value, plain = value_of(option), from_file(name, "")
    ways = {
        "keyword": kd.Simulation(plain, name, **step(name, key), **{key: value}),
        "file": kd.Simulation(from_file(name, f"{key} = {toml(value)}"), **step(name, key)),
        "text": kd.Simulation(plain, name, **step(name, key), **parsed([f"{key}={as_text(value)}"], {})),
        "value": kd.Simulation(plain, kd.integrator(name, **{key: value}), **step(name, key)),
    }
    for way, sim in ways.items():
        assert sim.options[key] == value, way
        assert getattr(sim.options, key) == value, way
        assert sim.checkpoint()["options"][key] == value, way
    assert len({sim.options for sim in ways.values()}) == 1


@pytest.mark.parametrize(("name", "key"), CASES)
def test_a_value_that_an_option_cannot_have_is_refused_by_its_name(name, key):
    option = declared(name, key)
    wrong, plain = wrong_value_of(option), from_file(name, "")
    with pytest.raises(InputError, match=rf"^{key}\b"):
        kd.Simulation(plain, name, **step(name, key), **{key: wrong})
    with pytest.raises(InputError, match=rf"run\.{key}: |^{key} "):
        kd.Simulation(from_file(name, f"{key} = {toml(wrong)}"), **step(name, key))
    with pytest.raises(InputError, match=rf"^{key}\b"):
        kd.Simulation(plain, name, **step(name, key), **parsed([f"{key}={as_text(wrong)}"], {}))
    with pytest.raises(InputError, match=rf"^{key}\b"):
        kd.integrator(name, **{key: wrong})


@pytest.mark.parametrize("name", METHODS)
def test_an_option_of_other_methods_is_refused_as_a_keyword_and_passed_over_in_a_file(name):
    others = [key for key in known_options() if key not in METHODS[name].tunable and key != PRECISION.name]
    assert others
    plain = from_file(name, "")
    for key in others:
        value = value_of(known_options()[key])
        with pytest.raises(InputError, match=f"^{key}: {name} does not take it; it takes dt"):
            kd.Simulation(plain, name, **step(name), **{key: value})
    sim = kd.Simulation(from_file(name, f"{others[0]} = {toml(value_of(known_options()[others[0]]))}"), **step(name))
    assert sim.options == kd.Simulation(plain, **step(name)).options


def test_defaults_are_those_declared():
    for name, method in METHODS.items():
        options = kd.Simulation(from_file(name, ""), name, **step(name)).options
        for each in method.declared:
            expected = each.default if each.written or each.name == "eta" else None
            assert options.get(each.name) == needed(name).get(each.name, expected), (name, each.name)
        assert options.precision is None
    options = kd.Simulation(from_file("dop853", ""), "dop853").options
    assert options.tolerances == (OPTIONS["rtol"].default, OPTIONS["atol"].default)


def test_what_a_file_names_of_options_is_what_it_was():
    """Names and order in files of version 0.1.0."""
    assert list(Options()) == [
        "dt", "rtol", "atol", "controller", "compensated", "iteration", "coordinates", "corrector", "order", "eta",
        "scheme", "precision", "max_step", "hill_radii", "pericentre", "inner",
    ]  # fmt: skip
    assert dict(Options()) == dict.fromkeys(Options()) | {"compensated": False}


def test_false_as_an_argument_replaces_true_in_a_file():
    system = from_file("yoshida4", "compensated = true")
    assert kd.Simulation(system, dt=0.1).options.compensated is True
    assert kd.Simulation(system, dt=0.1, compensated=False).options.compensated is False


def test_every_option_of_the_table_is_taken_by_a_method_and_is_a_key_of_run():
    assert list(known_options()) == [*OPTIONS, *YOUNGER]
    assert all(takers(name) for name in known_options())
    assert run_keys() == ["integrator", "dt", "steps", "time", "every", "interval", "times", *OPTIONS, *YOUNGER]
    assert takers(PRECISION.name) == list(METHODS)


UNKNOWN = [
    ("corector", "did you mean 'corrector', which wisdom-holman takes?"),
    ("coordinate", "did you mean 'coordinates', which wisdom-holman and saba take?"),
    ("Rtol", "did you mean 'rtol', which bogacki-shampine23, cash-karp45, dormand-prince45 and 6 others take?"),
    ("presicion", "did you mean 'precision', which every integrator takes?"),
]


@pytest.mark.parametrize(("key", "meant"), UNKNOWN)
def test_an_unknown_option_names_the_nearest_and_who_takes_it(key, meant):
    plain = from_file("velocity-verlet", "")
    with pytest.raises(InputError) as refused:
        kd.Simulation(plain, dt=0.1, **{key: 1})
    text = str(refused.value)
    assert text.startswith(f"{key}: no integrator takes such an option; ")
    assert meant in text
    assert text.endswith("? velocity-verlet takes dt, compensated")
    with pytest.raises(InputError) as refused:
        parsed([f"{key}=1"], {})
    assert str(refused.value) == f"{key}: no integrator takes such an option; {meant}"
    with pytest.raises(InputError) as refused:
        from_file("velocity-verlet", f"{key} = 1")
    assert f"run.{key}: unknown key; {meant} (known: " in str(refused.value)


def test_an_unknown_option_that_is_like_none_is_refused():
    with pytest.raises(InputError, match=r"^zzz: no integrator takes such an option; rk4 takes dt, compensated$"):
        kd.Simulation(from_file("rk4", ""), dt=0.1, zzz=3)
    with pytest.raises(InputError, match=r"^zzz: no integrator takes such an option"):
        kd.Simulation(from_file("rk4", ""), dt=0.1, zzz=None)
    with pytest.raises(InputError, match=r"^zzz: no integrator takes such an option"):
        kd.Simulation(from_file("rk4", "").with_run(zzz=3), dt=0.1)


def test_the_command_lines_texts():
    assert parsed(["rtol=1e-6,1e-7", "compensated=yes", "corrector=5", "dt=0.5"], {"eta": 0.1, "order": None}) == {
        "rtol": (1e-6, 1e-7), "compensated": True, "corrector": 5, "dt": 0.5, "eta": 0.1,
    }  # fmt: skip
    for text in ("corrector", "corrector=", "=3"):
        with pytest.raises(InputError, match="-o: expected KEY=VALUE"):
            parsed([text], {})
    with pytest.raises(InputError, match="-o eta: is given twice"):
        parsed(["eta=1"], {"eta": 0.5})
    with pytest.raises(InputError, match="-o eta: is given twice"):
        parsed(["eta=1", "eta=2"], {})


def test_options_are_values():
    one = Options(dt=0.1, corrector=3, rtol=[1e-3, 1e-4])
    assert one == Options(**one)
    assert hash(one) == hash(Options(**one))
    assert one != one.changed(corrector=5)
    assert one.rtol == (1e-3, 1e-4)
    with pytest.raises(AttributeError, match="read-only"):
        one.dt = 1.0
    with pytest.raises(AttributeError, match="friction"):
        one.friction


@pytest.mark.parametrize(("given", "message"), [
    ({"name": "two words"}, "expected a name such as friction"),
    ({"name": "threads"}, "that means nothing else"),
    ({"type": list}, "option friction: type must be float, int, str or bool"),
    ({"help": " "}, "option friction: help must say what it does"),
    (
        {"dimension": "length"},
        "option friction: dimension must be one of '', 'time', 'rate', 'temperature', 'pressure', 'compressibility', "
        "got 'length'",
    ),
    ({"choices": ("a",)}, "option friction: expected a number among choices, got 'a'"),
    ({"type": str, "choices": ("a b",)}, "option friction: expected a name among choices, got 'a b'"),
    ({"above": 0.0, "default": -1.0}, "friction must be a positive number, got -1.0"),
    ({"type": int, "default": 0.5}, "friction must be a whole number, got 0.5"),
    ({"most": 1.0, "default": 2.0}, "friction must be at most 1, got 2.0"),
])  # fmt: skip
def test_a_declaration_that_makes_no_sense_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Option(**({"name": "friction", "type": float, "help": "Friction."} | given))


def test_methods_that_declare_a_name_differently_are_told_apart():
    rtol = known_options()["rtol"]
    assert rtol.several
    assert rtol.default is None  # the default is 1e-9 for gauss-radau15, 1e-8 for the others
    assert not declared("gauss-radau15", "rtol").several
    one = Option("way", str, "Way.", "a", ("a", "b"))
    assert merged([one, replace(one, choices=("c", "a"))]).choices == ("a", "b", "c")
    assert merged([one, replace(one, choices=())]).choices == ()


def test_run_defaults_keep_options_apart():
    run = RunDefaults("rk4", 0.1, 5, rtol=1e-3, atol=None)
    assert run.options == {"rtol": 1e-3}
    assert run.changed(time=2.0, rtol=None) == RunDefaults("rk4", 0.1, None, 2.0)
    assert RunDefaults(**run.said()) == run
    assert hash(RunDefaults(**run.said())) == hash(run)


def test_mixed_precision_is_refused_where_a_method_declares_double_alone():
    for name, method in METHODS.items():
        mixed = MIXED in declared(name, PRECISION.name).choices
        assert mixed == (not method.float64_because)
        if not mixed:
            with pytest.raises(InputError, match=f"precision: {name} .* takes double alone"):
                kd.integrator(name, precision=MIXED)
