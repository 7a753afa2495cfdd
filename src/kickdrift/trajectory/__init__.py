"""The file of a run: written so that a kill leaves whole rows, read as untrusted data, checked and exported."""
