"""Registry of integrators. Importing it compiles nothing."""

from __future__ import annotations

from difflib import get_close_matches

from kickdrift.errors import InputError
from kickdrift.integrators.block_leapfrog import method as block_leapfrog
from kickdrift.integrators.event_driven import method as event_driven
from kickdrift.integrators.exact import method as exact
from kickdrift.integrators.gauss_radau import method as gauss_radau
from kickdrift.integrators.hermite import method as hermite
from kickdrift.integrators.implicit import method as implicit
from kickdrift.integrators.implicit import rosenbrock
from kickdrift.integrators.method import Method
from kickdrift.integrators.runge_kutta import method as runge_kutta
from kickdrift.integrators.runge_kutta import scipy_methods
from kickdrift.integrators.sheet import method as sei
from kickdrift.integrators.splitting import constant_temperature as baths
from kickdrift.integrators.splitting import method as splitting
from kickdrift.integrators.splitting import stormer
from kickdrift.integrators.trace import method as trace
from kickdrift.integrators.wisdom_holman import embedded
from kickdrift.integrators.wisdom_holman import method as wisdom_holman
from kickdrift.model.checks.arguments import other_name
from kickdrift.text import VALUE, shown

INTEGRATORS: dict[str, Method] = {
    row.name: row
    for row in (
        *splitting.ROWS,
        *baths.ROWS,
        *splitting.RESPA,
        *embedded.ROWS,
        *stormer.ROWS,
        *exact.ROWS,
        *stormer.STEP_DENSITY,
        *hermite.ROWS,
        *block_leapfrog.ROWS,
        *wisdom_holman.ROWS,
        *trace.ROWS,
        *sei.ROWS,
        *event_driven.ROWS,
        *runge_kutta.ROWS,
        *gauss_radau.ROWS,
        *implicit.ROWS,
        *rosenbrock.ROWS,
        *scipy_methods.ROWS,
    )
}
INTEGRATORS |= {alias: INTEGRATORS[name] for alias, name in (splitting.ALIASES | baths.ALIASES).items()}


def integrator(name: str) -> Method:
    """Method of that name. Raises an InputError that suggests the nearest names for an unknown one."""
    if not isinstance(name, str):
        raise InputError(f"integrator must be a name, got {shown(name)}")
    if name in INTEGRATORS:
        return INTEGRATORS[name]
    near = get_close_matches(name[:VALUE], INTEGRATORS, 3, 0.5)
    hint = f"; did you mean {', '.join(near)}?" if near else "; see: kickdrift list integrators"
    raise InputError(f"integrator {shown(name)} is unknown{other_name('integrator', name) or hint}")


def integrators() -> list[str]:
    """Names of all integrators, including aliases."""
    return list(INTEGRATORS)
