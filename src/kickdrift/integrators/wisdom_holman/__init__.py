"""Wisdom-Holman maps, their correctors and kernels: bodies in lanes, systems in lanes, and derivatives.

Imports `stepping`. `trace` uses its drifts.
"""
