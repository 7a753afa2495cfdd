"""Forces of planetary science, most of them around a central body: tides, spins, relativity, gas, radiation.

Imports `laws`.
"""
