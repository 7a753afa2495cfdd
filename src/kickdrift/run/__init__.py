"""The run: a Simulation, how far it goes, where it looks, what it reports, and how it is resumed."""
