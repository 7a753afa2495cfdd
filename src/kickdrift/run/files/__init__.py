"""The files that a run writes: when, by which writer, and what is saved when a force fails.

Imports the plan, the watchers and the integration under way. The Simulation uses it.
"""
