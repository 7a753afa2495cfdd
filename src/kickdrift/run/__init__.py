"""The run: a Simulation, its length, its looks, its report, and its restart."""
