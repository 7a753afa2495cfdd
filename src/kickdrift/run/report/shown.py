"""Lines that describe a run to people: its report, and a Simulation."""

import math
from dataclasses import asdict
from typing import Any

from kickdrift.display.card import Spark
from kickdrift.display.showing import Lines, Shown, above, lines_of
from kickdrift.integrators.options import mean_pressure
from kickdrift.looks.report_lines import energy_lines, energy_spark, mean_text, method_text, verdict_text
from kickdrift.model.event_log import event_lines
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.text import counted, measured


class ShownReport(Shown):
    """A Report that prints itself."""

    def _spark(self: Any) -> Spark | None:
        series = self.about.series
        return energy_spark(series.total, series.kinetic)

    def _lines(self: Any) -> Lines:
        units, output = self.about.units, self.about.output
        time_unit = units.symbol("time") if units else ""
        if units:
            lines = [("system", f"{self.system}: {self.particles:,} particles, units {self.units}")]
        else:
            lines = [("problem", f"{self.system}: {counted(len(self.y), 'unknown')}")]
        if self.engine != "native":
            where = f" in {self.processes} processes" if self.processes > 1 else ""
            lines.append(("engine", f"{self.engine} {self.engine_version}{where}"))
        chosen = {"dt": self.dt, "rtol": self.rtol, "atol": self.atol, **self.options}
        lines.append(("integrator", method_text(self.integrator, chosen, time_unit)))
        if units and self.charges is not None:
            lines += self.charges.lines(units.symbol("length"))
        if units and self.molecules is not None:
            lines += self.molecules.lines(units.symbol("length"), units.symbol("temperature"))
        if self.fixed:
            lines.append(("fixed", self.fixed))
        if self.equilibrated:
            lines.append(("equilibrated", self.equilibrated))
        steps = counted(self.steps, "step", ",")
        rejected = f" ({self.rejected_steps:,} rejected)" if self.rejected_steps else ""
        lines.append(("length", f"{steps}{rejected}, {measured(f'{self.time:g}', time_unit)}"))
        if self.y is not None:
            lines.append(("y at the end", ", ".join(f"{value:.10g}" for value in self.y)))
        energy_unit = units.symbol("energy") if units else ""
        if self.energy is not None:
            cause = self.about.cause
            lines += energy_lines(asdict(self.energy), energy_unit, time_unit, self.time, cause, self.heat, self.work)
        if self.momentum_error is not None:
            lines.append(("momentum error", f"{self.momentum_error:.1e} of the sum of m |v|"))
        if self.angular_momentum_error is not None:
            lines.append(("angular momentum", f"error {self.angular_momentum_error:.1e} of the sum of m |x × v|"))
        if units and self.temperature is not None:
            symbol, asked = units.symbol("temperature"), self.options.get("temperature")
            verdict = verdict_text(asked, self.temperature_verdict, symbol)
            lines.append(("temperature", f"{mean_text(self.temperature, self.temperature_error, symbol)}{verdict}"))
        if units and self.pressure is not None:
            per = symbol_of(f"{units.energy}/{units.length}^{self.about.dimensions}")
            verdict = verdict_text(mean_pressure(self.options), self.pressure_verdict, per)
            lines.append(("pressure", f"{mean_text(self.pressure, self.pressure_error, per)}{verdict}"))
        if units and self.tensor is not None:
            lines += self.tensor.lines(symbol_of(f"{units.energy}/{units.length}^{self.about.dimensions}"))
        if units and self.hits is not None:
            lines += self.hits.lines(time_unit)
        if self.pairs is not None:
            lines += self.pairs.lines()
        if units and self.volume is not None:
            per = symbol_of(f"{units.length}^{self.about.dimensions}")
            lines.append(("volume", mean_text(self.volume, self.volume_error, per)))
        shown = self.force_evaluations is not None and (not units or self.dt is None)
        evaluations = f"{self.force_evaluations:,} evaluations, " if shown else ""
        per_pair = f", {self.ns_per_pair:.1f} ns per pair" if self.ns_per_pair else ""
        where = counted(self.threads, "thread") if self.processes == 1 else f"{self.processes} processes"
        rate = self.steps_per_second
        speed = f"{rate:,.0f}" if rate >= 10 or not rate else f"{rate:.2g}"
        lines.append(("speed", f"{evaluations}{speed} steps/s on {where}{per_pair}"))
        lines.append(("took", took_text(self)))
        if self.energy_taken is not None:
            taken = measured(f"{self.energy_taken:.8g}", energy_unit)
            lines.append(("energy taken", f"{taken} by collisions and removed bodies"))
            if self.angular_momentum_error is not None and any(spin := self.angular_momentum_taken or ()):
                size = measured(f"{math.hypot(*spin):.6g}", units.symbol("angular momentum") if units else "")
                lines.append(("spin", f"angular momentum {size} went from orbits into bodies, or left with them"))
        if self.stopped:
            lines.append(("stopped", self.stopped))
        lines += [("warning", line) for line in self.warnings]
        lines += event_lines(self.events)
        if output:
            lines.append(("written", output))
        return lines


class ShownSimulation(Shown):
    """A Simulation that prints what runs, how, and how far it has come."""

    def __repr__(self: Any) -> str:
        return f"<Simulation of {self.system.name} with {self.integrator}: {counted(self.steps_done, 'step')} done>"

    def view(self, *, colour: str | None = None, size: float = 1.0, height: int | None = None) -> Any:
        """Show the particles in a picture that turns: a widget in a notebook, else an object with ``save(path)``.

        ``height`` is in pixels; ``colour`` and ``size`` are those of `kickdrift view`. See docs/live.md.
        In a notebook, the picture goes on while the Simulation runs."""
        return above("view")(self, colour=colour, size=size, height=height)

    def _spark(self: Any) -> Spark | None:
        if not self.record.looks:
            return None
        series = self.record.series()
        return energy_spark(series.total, series.kinetic)

    def _lines(self: Any) -> Lines:
        units = getattr(self.system, "units", None)
        unit = units.symbol("time") if units else ""
        lines = [line for line in lines_of(self.system) if line[0] not in ("time", "run", "equilibrate")]
        if self.engine != "native":
            lines.append(("engine", f"{self.engine} {self.engine_version}"))
        step = None if self.method.adaptive else self.dt
        chosen = {"dt": step, **self.options.extras(self.method.tunable)}
        lines.append(("integrator", method_text(self.integrator, chosen, unit)))
        lines.append(("done", f"{counted(self.steps_done, 'step')}, time {measured(f'{self.time:g}', unit)}"))
        return [*lines, *([("stopped", self.stopped)] if self.stopped else [])]


def took_text(report: Any) -> str:
    """Shares of a run's time: "1.4 s: stepping 0.9, 1001 looks 0.1, writing 0.3, compiling 0.1"."""
    seconds = {part: spent or 0.0 for part, spent in report.seconds.items()}
    total = sum(seconds.values())
    decimals = 0 if total >= 100 else 1 if total >= 1 else 2 if total >= 0.1 else 4
    looks = counted(report.samples, "look")
    names = {"looks": looks} if report.seconds["looks"] is not None else {"stepping": f"stepping and {looks}"}
    parts = [(names.get(part, part), f"{spent:.{decimals}f}") for part, spent in seconds.items()]
    said = ", ".join(f"{name} {spent}" for name, spent in parts if float(spent))
    return f"{total:.{decimals}f} s{f': {said}' if said else ''}"
