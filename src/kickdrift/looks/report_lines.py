"""Lines about a run for people: its method, and its energy with the error and the drift."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.display.card import Spark
from kickdrift.errors import InputError
from kickdrift.looks.record import Stretch, even_looks
from kickdrift.model.checks.values import unwarned
from kickdrift.model.state import Floats
from kickdrift.model.units.quantities import FAMILIAR
from kickdrift.statistics.drift import ROUNDINGS, Drift, EnergyError, drift, energy_error, rounding_of
from kickdrift.text import counted, measured, with_error


def method_text(name: str, options: Mapping[str, Any], time_unit: str = "") -> str:
    """Name of a method with the options that are not None."""
    said = [
        f"{key} = {measured(f'{value:g}', time_unit * (key == 'dt'))}"
        if isinstance(value, float)
        else f"{key} = {value}"
        for key, value in options.items()
        if value is not None
    ]
    return ", ".join([name, *said])


def energy_lines(
    energy: Mapping[str, Any],
    energy_unit: str,
    time_unit: str,
    length: float,
    cause: str = "",
    heat: float | None = None,
    work: float | None = None,
) -> list[tuple[str, str]]:
    """Lines of the values of an EnergyReport; values that are None are left out.

    ``length`` is the time of the run. ``cause`` follows a secular drift. ``heat`` is the energy from a heat bath, None
    without a bath; ``work`` is that from the change of the box, None without a barostat. Error and drift are then those
    of the energy less both."""
    less_heat = "" if heat is None else " (energy less heat)" if work is None else " (energy less heat and work)"
    by_force, missed = energy.get("work") or {}, energy.get("work_error") or 0.0
    conserved = not str(energy.get("verdict")).startswith("not conserved")
    if by_force and heat is None and conserved:
        less_heat = " (energy less work)"
    unit = measured("", energy_unit)
    per = f" per {time_unit or 'unit of time'}"
    lines = []
    if _are_numbers(energy, "initial", "final"):
        lines.append(("energy", f"{energy['initial']:.8g} at the start, {energy['final']:.8g}{unit} at the end"))
    if heat is not None:
        lines.append(("heat", f"{heat:.8g}{unit} from the heat bath"))
    if work is not None:
        lines.append(("work", f"{work:.8g}{unit} from the change of the box"))
    if by_force:
        found = ", ".join(f"{value:.6g}{unit} by {name}" for name, value in by_force.items())
        more = "" if conserved else "; look more often to count it"
        lines.append(("work", f"{found} (± {missed:.1e} by the distance between looks{more})"))
    if _are_numbers(energy, "rms_relative_error", "max_relative_error"):
        rms, largest = energy["rms_relative_error"], energy["max_relative_error"]
        lines.append(
            ("energy error", f"{rms:.2e} RMS, {largest:.2e} largest, of {energy.get('relative_to')}{less_heat}")
        )
    drift, verdict = drift_text(energy), energy.get("verdict")
    if isinstance(verdict, str):
        context = _size(energy, length) + cause if drift and verdict == "secular drift" else ""
        lines.append(("energy drift", (f"{drift}{per}: {verdict}{context}" if drift else verdict) + less_heat))
    return lines


def pair_lines(pairs: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How many pairs hermite4 regularises, from a report or from its file, which may be damaged."""
    formed, broken, bodies = (pairs.get(key) for key in ("formed", "broken", "bodies"))
    if not (isinstance(formed, int) and isinstance(broken, int) and isinstance(bodies, list | tuple)):
        return []
    return [("pairs", f"{counted(len(bodies), 'pair')} now; {formed:,} formed, {broken:,} broken up")]


def molecule_lines(found: Mapping[str, Any], length: str, temperature: str) -> list[tuple[str, str]]:
    """Lines of the values of a MoleculeReport, with the units of length and temperature."""
    lines = []
    if _are_numbers(found, "constraints", "error"):
        held = counted(int(found["constraints"]), "rigid distance", ",")
        lines.append(("constraints", f"{held}, largest relative error {found['error']:.1e}"))
    if _are_numbers(found, "moved", "lost") and (found["moved"] or found["lost"]):
        moved = measured(f"{found['moved']:.3g}", length)
        said = f"positions by up to {moved}, velocities by {found['lost']:.2g} of the kinetic energy"
        lines.append(("start", f"projected on the constraints: {said}"))
    means, errors = found.get("temperatures"), found.get("errors")
    if isinstance(means, Mapping) and means and isinstance(errors, Mapping) and _are_numbers(means, *means):
        parts = []
        for kind, mean in means.items():
            text = with_error(mean, errors[kind]) if _are_numbers(errors, kind) and errors[kind] else f"{mean:.5g}"
            parts.append(f"{measured(text, temperature)} of {kind}")
        verdict = found.get("verdict")
        lines.append(("molecules", ", ".join(parts) + (f": {verdict}" if verdict else "")))
    bias = found.get("step_bias")
    if isinstance(bias, Mapping) and bias and _are_numbers(bias, *bias):
        low = ", ".join(f"{measured(f'{each:.2g}', temperature)} of {kind}" for kind, each in bias.items())
        lines.append(("step bias", f"temperatures at whole steps lack {low}, to leading order"))
    return lines


def charge_lines(found: Mapping[str, Any], length: str) -> list[tuple[str, str]]:
    """Lines of the values of a ChargeReport, with the unit of length."""
    said = [str(found.get("method"))]
    if _are_numbers(found, "cutoff"):
        said.append(f"cutoff = {measured(format(found['cutoff'], '.5g'), length)}")
    if _are_numbers(found, "alpha"):
        said.append(f"alpha = {measured(format(found['alpha'], '.5g'), length and f'1/{length}')}")
    if _are_numbers(found, "waves"):
        said.append(f"{found['waves']:,} waves")
    if found.get("mesh"):
        said.append(f"mesh {' x '.join(map(str, found['mesh']))}, order {found.get('order')}")
    if _are_numbers(found, "vacuum"):
        said.append(f"slab with a vacuum of {measured(format(found['vacuum'], '.5g'), length)}")
    lines = [("charges", ", ".join(said))]
    if _are_numbers(found, "predicted_error", "accuracy"):
        errors = f"{found['predicted_error']:.1e} predicted"
        if _are_numbers(found, "measured_error"):
            errors += f", {found['measured_error']:.1e} measured for {found.get('measured_particles')} particles"
        lines.append(("force error", f"{errors}, of {found.get('relative_to')}; asked {found['accuracy']:.1e}"))
    return lines


def mean_text(mean: float, error: float | None, unit: str) -> str:
    """A mean over the samples with its standard error, if there is one, and its unit.

    A value in a unit that people rarely think in has a familiar unit beside it, such as bar or GPa."""
    return f"{mean_with_units(mean, error, unit)} (mean)"


def mean_with_units(mean: float, error: float | None, unit: str) -> str:
    """A mean with its error in its unit, and in a familiar unit if that is another."""
    texts = [(mean, error or 0.0, unit)]
    if unit in FAMILIAR:
        scale, familiar = FAMILIAR[unit]
        if familiar == "bar" and abs(mean) * scale >= 1e4:
            scale, familiar = scale * 1e-4, "GPa"
        texts.append((mean * scale, (error or 0.0) * scale, familiar))
    return " = ".join(measured(with_error(value, off) if off else f"{value:.5g}", name) for value, off, name in texts)


def tensor_lines(found: Mapping[str, Any], unit: str) -> list[tuple[str, str]]:
    """Lines of the values of a TensorReport, with the unit of pressure."""
    given = [found.get(key) for key in ("names", "means", "errors", "asked", "verdicts")]
    columns = [each if isinstance(each, list | tuple) else () for each in given]
    return [
        (f"pressure {name}", f"{mean_text(mean, error, unit)}, asked {mean_with_units(asked, None, unit)}: {said}")
        for name, mean, error, asked, said in zip(*columns, strict=False)
    ]


def verdict_text(asked: float | None, verdict: str | None, unit: str) -> str:
    """The value asked of a bath or a barostat with its verdict, as text; empty without a verdict."""
    return "" if verdict is None or asked is None else f", asked {measured(f'{asked:g}', unit)}: {verdict}"


def drift_text(energy: Mapping[str, Any]) -> str:
    """Slope and its interval; empty without a finite interval."""
    if not _are_numbers(energy, "drift_per_unit_time", "drift_error") or not math.isfinite(energy["drift_error"]):
        return ""
    return f"{energy['drift_per_unit_time']:+.1e} ± {energy['drift_error']:.1e}"


def _size(energy: Mapping[str, Any], length: float) -> str:
    """Size of a drift over the run."""
    of = {"initial energy": " of the energy", "kinetic energy": " of the kinetic energy"}
    size = abs(energy["drift_per_unit_time"] * length)
    return f", {size:.0e}{of.get(energy.get('relative_to', ''), '')} over this run"


def _are_numbers(values: Mapping[str, Any], *keys: str) -> bool:
    return all(isinstance(value := values.get(key), int | float) and not math.isnan(value) for key in keys)


def energy_spark(total: ArrayLike, kinetic: float) -> Spark | None:
    """Relative error of the energies (n,); ``kinetic`` is K(0). None for fewer than two energies, and without any."""
    energies = np.asarray(total, dtype=float)
    if len(energies) < 2:
        return None
    try:
        found = energy_error(energies, np.nan_to_num(kinetic))
    except InputError:  # energies that are not finite
        return None
    scale = {"initial energy": abs(found.initial), "kinetic energy": abs(float(kinetic))}.get(found.relative_to, 1.0)
    relative = "" if found.relative_to == "absolute" else f" of the {found.relative_to}"
    values = ((energies - found.initial) / scale).tolist()
    return Spark(values, f"energy error: RMS {found.rms_relative_error:.2g}{relative}")


@unwarned
def energy_trend(
    steps: NDArray[np.int64],
    times: Floats,
    total: Floats,
    kinetic: float,
    even: bool,
    error: EnergyError,
    looks: Stretch | None = None,
) -> Drift:
    """Drift of the relative energy error.

    Parameters
    ----------
    steps, times, total : (k,) of the samples
    kinetic : the first sample's kinetic energy; nan if there is none
    even : whether steps are equally long. Otherwise the errors are interpolated to evenly spaced times.
    error : the ``energy_error`` of ``total``
    looks : the `even_looks`, if they are known

    Raises
    ------
    InputError
        For values that are not finite.
    """
    first = 0.0 if np.isnan(kinetic) else kinetic
    scale = {"initial energy": abs(error.initial), "kinetic energy": kinetic}.get(error.relative_to, 1.0)
    at, errors = times, (total - error.initial) / scale
    if even:
        chosen = even_looks(steps, times) if looks is None else looks
        at, errors = at[chosen], errors[chosen]
    if at[-1] < at[0]:  # back in time
        at, errors = at[::-1], errors[::-1]
    if not even and len(at) > 2:  # the step points of an adaptive run are only about evenly spaced
        grid = np.linspace(at[0], at[-1], len(at))
        at, errors = grid, np.interp(grid, at, errors)
    rounding = rounding_of(max(abs(error.initial), first), int(steps[-1] - steps[0])) / scale
    trend = drift(at, errors, rounding)
    over_run = abs(trend.slope * (times[-1] - times[0]))
    tiny = trend.verdict == "secular drift" and over_run <= ROUNDINGS * rounding
    return replace(trend, verdict="round-off") if tiny else trend
