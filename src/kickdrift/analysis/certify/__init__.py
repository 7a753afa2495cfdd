"""Certificates: whether a run samples its ensemble, and whether a force is fit for dynamics.

Imports `observables`.
"""
