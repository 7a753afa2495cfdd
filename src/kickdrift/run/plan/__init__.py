"""The plan of a run: how many steps, when the run looks, and whether it goes back in time.

Imports no other part of a run. The loop, the looks and the outputs use it.
"""
