"""Files on disk: open, create, recognise and replace them safely. Knows nothing of their content."""
