"""Molecules: lists of bonds, angles, dihedrals and impropers, relatives along bonds, constraints, virtual sites.

Imports checks and the box. Systems and bonded forces use `topology`.
"""
