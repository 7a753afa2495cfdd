"""Gravity by direct summation, among few bodies, among many, in lanes of systems, and in a shearing sheet.

Imports `laws`, `fields` and the layout of clusters.
"""
