"""The file of a Problem's run: written, read, described, and as a table."""
