"""Star clusters: radii, core, relaxation, anisotropy, binaries and escapers of a system or over a run.

Imports `orbits`.
"""
