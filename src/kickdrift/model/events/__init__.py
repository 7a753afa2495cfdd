"""What a run can watch for, as plain data: close approaches, collisions, escapes and crossings.

Imports checks and the state. Systems hold events; the run searches for them.
"""
