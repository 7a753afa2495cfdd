"""Machine code on disk: keys that cover every source, files with checksums, private folders, removal of old code.

Imports numba's private names alone. Others use `DriverCache`, and `notices` to hear of compilation.
"""
