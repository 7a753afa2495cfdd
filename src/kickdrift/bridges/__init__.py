"""Conversion of systems to and from other programs; one module for each program."""
