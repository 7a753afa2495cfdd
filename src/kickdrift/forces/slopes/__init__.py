"""Slopes of forces: how accelerations change with positions and parameters, for deviations and tangent maps.

Imports all families, each of which keeps its own slopes. Analysis and tangent maps use it.
"""
