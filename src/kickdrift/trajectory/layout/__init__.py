"""What a run's file holds and where: names, shapes, checksums, the header, and the record of the System.

Imports `file`. Writers and readers use it.
"""
