"""Simulations of rebound from our Systems, and energies of bodies in extended precision."""

from typing import Any

import numpy as np

import kickdrift as kd

Phase = tuple[np.ndarray, np.ndarray]  # positions and velocities (n, 3)


def simulation(
    system: kd.System, integrator: str, dt: float | None = None, G: float | None = None, factor: float = 1.0
) -> Any:
    """rebound's Simulation of the same bodies, the massless ones last; positions are times ``factor``."""
    import rebound

    sim, state = rebound.Simulation(), system.state
    sim.G = float(system.units.gravity or 1.0) if G is None else G
    radii = np.zeros(len(system)) if system.radii is None else system.radii
    for m, x, v, r in zip(state.masses, factor * state.positions, state.velocities, radii, strict=True):
        sim.add(m=m, x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2], r=r)
    if not state.masses.all():
        sim.N_active = int((state.masses > 0.0).sum())
    sim.integrator = integrator
    if dt is not None:
        sim.dt = dt
    return sim


def phase(sim: Any) -> Phase:
    """Positions and velocities, synchronised."""
    sim.synchronize()
    x, v = np.zeros((2, sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    return x, v


def put(sim: Any, state: kd.State) -> None:
    """Give rebound's particles the places and velocities of a state."""
    for body, x, v in zip(sim.particles, state.positions, state.velocities, strict=True):
        (body.x, body.y, body.z), (body.vx, body.vy, body.vz) = x, v


def energy(m: np.ndarray, x: np.ndarray, v: np.ndarray, G: float = 1.0) -> Any:
    """Energy of bodies at these positions and velocities, in extended precision."""
    m, x, v = (np.asarray(part, dtype=np.longdouble) for part in (m, x, v))
    total = (m[:, None] * v * v).sum() / 2
    for i in range(1, len(m)):
        total -= np.longdouble(G) * (m[i] * m[:i] / np.sqrt(((x[:i] - x[i]) ** 2).sum(axis=1))).sum()
    return total
