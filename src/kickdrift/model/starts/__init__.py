"""Initial states: lattices, velocities, star clusters, orbits and the planets."""
