"""Lines that describe a run to people: its report, and a Simulation."""

from __future__ import annotations

import math
from typing import Any

from kickdrift.display.showing import Lines, Shown, lines_of
from kickdrift.model.event_log import event_lines
from kickdrift.model.unit_systems import symbol_of
from kickdrift.text import counted, measured


class ShownReport(Shown):
    """A Report that prints itself."""

    def __repr__(self) -> str:
        return str(self)

    def _lines(self: Any) -> Lines:
        units, output = self.about.units, self.about.output
        time_unit = measured("", units.symbol("time")) if units else ""
        if units:
            lines = [("system", f"{self.system}: {self.particles:,} particles, units {self.units}")]
        else:
            lines = [("problem", f"{self.system}: {counted(len(self.y), 'unknown')}")]
        if self.engine != "native":
            where = f" in {self.processes} processes" if self.processes > 1 else ""
            lines.append(("engine", f"{self.engine} {self.engine_version}{where}"))
        chosen = {"dt": self.dt, "rtol": self.rtol, "atol": self.atol, **self.options}
        lines.append(("integrator", method_text(self.integrator, chosen, time_unit)))
        rejected = f" ({self.rejected_steps:,} rejected)" if self.rejected_steps else ""
        lines.append(("length", f"{self.steps:,} steps{rejected}, {self.time:g}{time_unit}"))
        if self.y is not None:
            lines.append(("y at the end", ", ".join(f"{value:.10g}" for value in self.y)))
        energy, unit = self.energy, measured("", units.symbol("energy")) if units else ""
        if energy is not None:
            errors = f"{energy.rms_relative_error:.2e} RMS, {energy.max_relative_error:.2e} largest"
            drift = drift_text(energy, f" per {time_unit.strip() or 'unit of time'}: {energy.verdict}")
            lines += [
                ("energy", f"{energy.initial:.8g} at the start, {energy.final:.8g}{unit} at the end"),
                ("energy error", f"{errors}, of {energy.relative_to}"),
                ("energy drift", drift or energy.verdict),
            ]
        if self.momentum_error is not None:
            lines.append(("momentum error", f"{self.momentum_error:.1e} of the sum of m |v|"))
        if self.angular_momentum_error is not None:
            lines.append(("angular momentum", f"error {self.angular_momentum_error:.1e} of the sum of m |x × v|"))
        if units and self.temperature is not None:
            mean = measured(f"{self.temperature:.5g}", units.symbol("temperature"))
            lines.append(("temperature", f"{mean} (mean)"))
        if units and self.pressure is not None:
            per = symbol_of(f"{units.energy}/{units.length}^{self.about.dimensions}")
            lines.append(("pressure", f"{measured(f'{self.pressure:.5g}', per)} (mean)"))
        shown = self.force_evaluations is not None and (not units or self.dt is None)
        evaluations = f"{self.force_evaluations:,} evaluations, " if shown else ""
        per_pair = f", {self.ns_per_pair:.1f} ns per pair" if self.ns_per_pair else ""
        where = counted(self.threads, "thread") if self.processes == 1 else f"{self.processes} processes"
        rate = self.steps_per_second
        speed = f"{rate:,.0f}" if rate >= 10 or not rate else f"{rate:.2g}"
        lines.append(("speed", f"{evaluations}{speed} steps/s on {where}{per_pair}"))
        if self.energy_taken is not None:
            lines.append(("energy taken", f"{self.energy_taken:.8g}{unit} by collisions and removed bodies"))
        if self.stopped:
            lines.append(("stopped", self.stopped))
        lines += event_lines(self.events)
        if output:
            lines.append(("written", output))
        return lines


class ShownSimulation(Shown):
    """A Simulation that prints what runs, how, and how far it has come."""

    def __repr__(self: Any) -> str:
        return f"<Simulation of {self.system.name} with {self.integrator}: {counted(self.steps_done, 'step')} done>"

    def _lines(self: Any) -> Lines:
        units = getattr(self.system, "units", None)
        unit = measured("", units.symbol("time")) if units else ""
        lines = [line for line in lines_of(self.system) if line[0] not in ("run", "equilibrate")]
        if self.engine != "native":
            lines.append(("engine", f"{self.engine} {self.engine_version}"))
        step = None if self.method.adaptive else self.dt
        chosen = {"dt": step, **self.options.extras(self.method.tunable)}
        lines.append(("integrator", method_text(self.integrator, chosen, unit)))
        lines.append(("done", f"{counted(self.steps_done, 'step')}, time {self.time:g}{unit}"))
        return [*lines, *([("stopped", self.stopped)] if self.stopped else [])]


def method_text(name: str, options: dict[str, Any], time_unit: str = "") -> str:
    """Name of a method with the options that are not None."""
    said = [
        f"{key} = {value:g}{time_unit * (key == 'dt')}" if isinstance(value, float) else f"{key} = {value}"
        for key, value in options.items()
        if value is not None
    ]
    return ", ".join([name, *said])


def drift_text(energy: Any, ending: str = "") -> str:
    """Text of the slope of an EnergyReport, its interval and the ending; empty without a finite interval."""
    if not math.isfinite(energy.drift_error):
        return ""
    return f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e}{ending}"
