"""Standard test problems of the literature: factories of Problems, by name.

Each takes its starting values ``y0``, its parameters and the starting time ``t0``, all with defaults.
"""

from collections.abc import Callable

from kickdrift.model.problem import Problem
from kickdrift.odes.kinetics import hires, logistic, lorenz, lotka_volterra, orego, robertson, van_der_pol
from kickdrift.odes.mechanics import arenstorf, harmonic_oscillator, henon_heiles, kepler, pendulum, pleiades

ODES: dict[str, Callable[..., Problem]] = {
    "harmonic-oscillator": harmonic_oscillator,
    "pendulum": pendulum,
    "kepler": kepler,
    "logistic": logistic,
    "lotka-volterra": lotka_volterra,
    "van-der-pol": van_der_pol,
    "robertson": robertson,
    "hires": hires,
    "orego": orego,
    "arenstorf": arenstorf,
    "pleiades": pleiades,
    "lorenz": lorenz,
    "henon-heiles": henon_heiles,
}
