"""Runs at a step and at half the step on the same noise, from common starts, and what their differences say.

Two long runs at different steps measure the error of a mean badly: the difference of the means is small, and the error
of each mean is large. Paths on the same noise stay together for a while, and their differences scatter little. Chaos
parts them in the end. So a coarse path leaves a fine one, is compared with it after a stretch, and begins anew there.

Within a stretch most properties reach their values for the longer step. The energy alone may be slow: only the bath
changes the total. In the long run the bath gives what the discretization takes, so the mean kinetic energy that the
bath meets is known (see `Bath`). What is left of the energy's way is added by linear response, with the
fluctuations of the fine path: d<A> / d<K> = cov(A, E) / cov(K, E). For every factor the result is exact for long
stretches; this one makes short stretches do.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator, takers_text
from kickdrift.integrators.options import NOISE, REFINE
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.subflows import DRIFT, FLOWS, KICK
from kickdrift.looks.observers import kinetic_energy
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation
from kickdrift.statistics.blocks import block_average

TOGETHER = 0.01  # part of the whole difference of forces up to which paths count as together
FEWEST = 20  # stretches behind an error bar
POTENTIAL, KINETIC, PRESSURE, MET, WORK = range(5)  # columns of a look; MET is the kinetic energy that the bath meets
LOOKS = 2  # in a stretch: in the middle and at the end


class Difference(NamedTuple):
    """Means at a step less means at half the step: potential and kinetic energy of all particles, and pressure.

    values, errors : (3,) the differences and their standard errors
    half : (3,) the differences after half a stretch, the same way
    apart : (3,) how far the two are apart, in standard errors
    gain : how many times the steps two independent runs need for the error of the potential energy; nan if unknown
    """

    values: Floats
    errors: Floats
    half: Floats
    apart: Floats
    gain: float


def coupled_word(method: Integrator) -> Splitting:
    """The word of a method whose noise can be refined. Raises InputError for any other."""
    word = method.method
    if not isinstance(word, Splitting) or NOISE.name not in word.tunable:
        raise InputError(
            f"{method.name}: compare couples paths by {NOISE.name} = {REFINE}, and {method.name} does not take it; "
            f"{takers_text(NOISE.name)} it"
        )
    if word.groups:
        raise InputError(
            f"{method.name}: compare measures baths whose kicks are by all forces, not by groups of forces"
        )
    return word


class CoupledPaths:
    """A path at a step and a path at half the step.

    Raises InputError for a method without the option ``noise``."""

    def __init__(self, system: System, method: Integrator, dt: float, start: State, threads: int = 1) -> None:
        word = coupled_word(method)
        self.word, self.dt, self.system = word, dt, system
        self.coarse = Simulation(system, method, dt, threads=threads)
        self.fine = Simulation(system, method, 0.5 * dt, threads=threads, noise=REFINE)
        self.coarse.state = self.fine.state = start
        self.steps = 0
        for sim in (self.coarse, self.fine):
            sim.integration.prepare()

    def meet(self) -> None:
        """Let the coarse path begin anew where the fine path is."""
        fine = self._stepper(self.fine)
        self._stepper(self.coarse).reset(fine.y.copy(), fine.time, fine.steps_done // 2)

    def advance(self, steps: int) -> None:
        """Take that many steps of the coarse path, and twice as many of the fine one."""
        self.coarse.advance(steps)
        self.fine.advance(2 * steps)
        self.steps += 3 * steps

    def look(self) -> Floats:
        """Potential energy, kinetic energy, pressure, kinetic energy that the bath meets, and total energy less heat:
        (2, 5) for the coarse and the fine path."""
        return np.array([self._row(sim) for sim in (self.coarse, self.fine)])

    def parted(self) -> float:
        """How far the paths have parted: the squared difference of the accelerations over its value for paths that have
        nothing in common."""
        first, second = (self._accelerations(sim, self._stepper(sim).y) for sim in (self.coarse, self.fine))
        return float(((first - second) ** 2).sum() / ((first**2).sum() + (second**2).sum()))

    def _row(self, sim: Simulation) -> tuple[float, ...]:
        run = sim.integration
        found = run.flow.sample(run.stepper.y, run.stepper.time, run.stepper.steps_done, run.fresh)
        heat = self._stepper(sim).heat
        energies = found.energies
        return energies.potential, energies.kinetic, found.pressure, self._met(sim), energies.total - heat

    def _met(self, sim: Simulation) -> float:
        """Kinetic energy that the bath meets: the mean of the energies after its last action and before its next one.
        Drifts and kicks between are undone or taken in a copy. The mean belongs to the time of the look."""
        letters = list(zip(self.word.letters, self.word.weights, strict=True))
        return 0.5 * (self._beyond(sim, letters, 1.0) + self._beyond(sim, letters[::-1], -1.0))

    def _beyond(self, sim: Simulation, letters: list[tuple[str, float]], sign: float) -> float:
        y, dt = self._stepper(sim).y.copy(), sign * float(sim.dt or 0.0)
        for letter, weight in letters:
            if FLOWS[letter].bath:
                break
            if letter == KICK:
                y[1] += weight * dt * self._accelerations(sim, y)
            elif letter == DRIFT:
                y[0] += weight * dt * y[1]
        return kinetic_energy(self.system.coherent_masses, y[1])

    def _accelerations(self, sim: Simulation, y: Floats) -> Floats:
        flow: Any = sim.integration.flow
        found: Floats | None = flow.accelerations(y, sim.integration.stepper.time)
        return np.full_like(y[0], np.nan) if found is None else found

    @staticmethod
    def _stepper(sim: Simulation) -> Any:
        return sim.integration.stepper


def stretch_of(paths: CoupledPaths, longest: int, pilots: int = 3) -> int:
    """Steps for which the paths stay together, at most ``longest`` and at least two; an even number."""
    found = []
    for _ in range(pilots):
        paths.meet()
        done = 0
        while done < longest:
            block = min(1 + done // 8, longest - done)
            paths.advance(block)
            done += block
            if not paths.parted() < TOGETHER:
                break
        found.append(done)
    return max(2, int(np.median(found)) // 2 * 2)


def stretches(paths: CoupledPaths, steps: int, count: int) -> Floats:
    """Looks at that many stretches of that many steps: (count, LOOKS, 2, 5)."""
    found = []
    for _ in range(count):
        paths.meet()
        looks = []
        begin = paths.look()[:, WORK]
        for _ in range(LOOKS):
            paths.advance(steps // LOOKS)
            looks.append(paths.look())
            looks[-1][:, WORK] -= begin
        found.append(looks)
    return np.array(found)


def difference(looks: Floats, paths: CoupledPaths, steps: int) -> Difference:
    """The difference of the means for all looks of stretches of ``steps`` steps; errors by the jackknife of blocks."""
    parts = np.array_split(np.arange(len(looks)), min(FEWEST, len(looks)))
    left_out = [np.delete(np.arange(len(looks)), part) for part in parts]
    whole = _estimates(looks, paths, steps)
    each = np.array([_estimates(looks[rest], paths, steps) for rest in left_out])
    errors = np.sqrt((len(parts) - 1) * ((each - each.mean(axis=0)) ** 2).mean(axis=0))
    gaps = each[:, 1] - each[:, 0]
    gap_errors = np.sqrt((len(parts) - 1) * ((gaps - gaps.mean(axis=0)) ** 2).mean(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(whole[1] - whole[0]) / gap_errors
    alone = float(block_average(looks[:, :, 1, POTENTIAL].ravel()).error)
    own = float(errors[1, POTENTIAL])
    gain = 2.0 * (alone / own) ** 2 if math.isfinite(alone) and own > 0 else math.nan
    return Difference(whole[1], errors[1], whole[0], apart, gain)


def _estimates(looks: Floats, paths: CoupledPaths, steps: int) -> Floats:
    """Differences of the three means after half a stretch and after a whole one, (LOOKS, 3)."""
    mean = looks.mean(axis=0)
    found = mean[:, 0, :3] - mean[:, 1, :3]
    if paths.word.overdamped:  # no energy is kept in velocities
        return found
    fine = looks[:, :, 1].reshape(-1, looks.shape[-1])
    energy = fine[:, POTENTIAL] + fine[:, KINETIC]
    by_energy = np.array([np.cov(fine[:, k], energy)[0, 1] for k in range(3)])
    coarse, finer = bath_of(paths, paths.coarse), bath_of(paths, paths.fine)
    work = (mean[-1, :, WORK] - mean[0, :, WORK]) / (steps - steps // LOOKS)  # of the later half
    lasting = coarse.share * work[0] - finer.share * 0.5 * work[1]  # in the long run, of the energy that is met
    lacking = lasting - (mean[0, 0, MET] - mean[0, 1, MET])  # of it in the middle of the stretch
    slow = coarse.rate * by_energy[KINETIC] / np.var(energy, ddof=1)
    later = math.exp(-slow * (steps - steps // LOOKS) * paths.dt)
    response = lacking * by_energy / by_energy[KINETIC]
    found += np.array([response, later * response])
    found[:, KINETIC] = mean[:, 0, KINETIC] - mean[:, 1, KINETIC] - (mean[:, 0, MET] - mean[:, 1, MET]) + lasting
    return found


class Bath(NamedTuple):
    """Effect of a bath on the mean kinetic energy in the long run.

    rate : heat that it gives in a unit of time for each unit that the kinetic energy lacks
    share : what the kinetic energy that it meets has in excess, for each unit that the discretization takes in a step

    Each time that the bath acts, it gives 1 - c^2 times what is lacking, c the part of a velocity that is kept, and c^2
    of the excess is left. A look is half-way between, or, in a word that begins and ends with the bath, after it."""

    rate: float
    share: float


def bath_of(paths: CoupledPaths, sim: Simulation) -> Bath:
    """The numbers of the word's bath at the step of a Simulation."""
    word, dt = paths.word, float(sim.dt or 0.0)
    letter = next(letter for letter in word.letters if FLOWS[letter].bath)
    times = len(word.of(letter))
    damping = float(sim.options["friction"]) * dt / times
    kept = math.exp(-damping) if letter != "G" else (1.0 - 0.5 * damping) / (1.0 + 0.5 * damping)
    left, given = kept * kept, 1.0 - kept * kept
    if word.letters[0] == word.letters[-1] == letter:
        return Bath(given * times / dt, left / (1.0 - left * left + (times - 2) * given))
    return Bath(given * times / dt, 0.5 * (1.0 + left) / (times * given))
