"""Pydantic models of the JSON texts in a run's file. Unknown keys are ignored."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, create_model

from kickdrift.integrators.options import OPTIONS
from kickdrift.trajectory.layout.contents import Contents, short

Whole = Annotated[int, Field(ge=0, lt=2**63)]
Number = Annotated[int, Field(ge=1, lt=2**31)]
Positive = Annotated[float, Field(gt=0)]
Name = Annotated[str, StringConstraints(pattern=r"^[^/\x00-\x1f\x7f][^\x00-\x1f\x7f]{0,199}$")]  # name of a method
Precision = Literal["double", "mixed"]  # precision of pair forces


class Stored(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)


class Described(Stored):
    """A force or an event of the system."""

    type: str
    module: str
    parameters: Any
    source: str = ""


_TYPES: dict[str, Any] = {name: (each.type | None, None) for name, each in OPTIONS.items()}


class OptionsText(create_model("OptionsOfTheTable", __base__=Stored, **_TYPES)):  # type: ignore[misc]
    """Options of a method. A method's own options are checked when the method is made."""

    dt: Positive | None = None
    precision: Precision | None = None


class RunText(OptionsText):
    """Values of the system file's [run]."""

    integrator: Name | None = None
    steps: Whole | None = None
    time: Positive | None = None
    every: Whole | None = None


class EquilibrationText(Stored):
    temperature: float
    time: float | None = None
    steps: Number | None = None
    interval: Number = 10
    to: float | None = None
    integrator: Name | None = None


class BoxText(Stored):
    """A leaning box, or a box that is open along an axis."""

    matrix: Annotated[
        list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=3, max_length=3)
    ]
    periodic: Annotated[list[bool], Field(min_length=3, max_length=3)]


class RecordText(Stored):
    """Content of `kickdrift/system/record`."""

    name: str
    units: str
    particles: Whole
    box: Annotated[list[Positive], Field(min_length=3, max_length=3)] | BoxText | None
    dimensions: Literal[2, 3] = 3
    species: list[str]
    names: list[str] = []
    radii: list[float] | None = None
    events: list[Described] = []
    forces: list[Described]
    run: RunText = RunText()
    equilibration: EquilibrationText | None = None
    invariants: dict[str, Any] = {}
    seed: Whole | None = None
    room: Whole = 0
    time: float
    steps_done: Whole


class ProblemText(Stored):
    """`kickdrift/problem/record`."""

    name: str
    unknowns: Number
    t0: float
    separable: bool
    equation: str = ""
    parameters: dict[str, Any] = {}
    run: RunText = RunText()
    invariants: dict[str, Any] = {}
    functions: dict[str, str] = {}
    slopes: list[list[float]] = []
    events: list[str] = []


class MethodText(Stored):
    """Content of `kickdrift/method`."""

    integrator: Name | None = None
    order: int | Name | None = None  # "10,6,4" for a saba method
    dt: Positive | None = None
    threads: Number = 1
    seed: int | None = None
    engine: Name = "native"
    engine_version: str | None = None
    processes: Number = 1
    precision: Precision | None = None
    options: OptionsText = OptionsText()
    processor: str = "unknown"


class VersionsText(Stored):
    """Content of `kickdrift/versions`."""

    kickdrift: str | None = None
    numba: str | None = None
    llvmlite: str | None = None


class EventText(Stored):
    """An event that was going on at the end of the run."""

    kind: str
    time: float
    step: Whole
    bodies: list[str]
    ids: list[int]
    distance: float | None
    energy: float | None
    done: str


class ReportText(Stored):
    """Content of `kickdrift/report`."""

    stopped: str = ""
    events: list[EventText] = []
    warnings: list[str] = []


def checked(contents: Contents, given: Any, model: type[Stored], name: str) -> dict[str, Any]:
    """Value of the JSON text with this ``name``, checked by the ``model``."""
    try:
        model.model_validate(given)
    except ValidationError as errors:
        error = errors.errors(include_url=False)[0]
        place = ".".join(str(part) for part in error["loc"])
        what = f"{name}{': ' * bool(place)}{place}: {error['msg']}"
        raise contents.damaged(what if error["type"] == "missing" else f"{what}, got {short(error['input'])}") from None
    except (RecursionError, ValueError, TypeError) as error:
        raise contents.damaged(f"{name}: {error}") from None
    return dict(given)


def read(contents: Contents, name: str, model: type[Stored]) -> dict[str, Any]:
    """Read and check a JSON text of the file."""
    return checked(contents, contents.json(name), model, name)
