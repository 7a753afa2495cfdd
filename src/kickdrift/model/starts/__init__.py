"""Where Systems begin: lattices, velocities, star clusters, orbits and the planets."""
