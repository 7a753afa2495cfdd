"""Gravity by a tree, to an accuracy that the user states.

Imports `laws` and `seam`.
"""
