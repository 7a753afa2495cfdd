"""Derivatives of a motion's end and of transit times with respect to the start.

Imports `tangents` and `chaos`.
"""
