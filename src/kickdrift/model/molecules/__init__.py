"""Molecules: bonds, angles, dihedrals and impropers as lists, and relatives along bonds.

Imports checks and the box. Systems and bonded forces use `topology`.
"""
