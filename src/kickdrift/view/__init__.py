"""Views that turn in a browser: a scene, its packed text, and a page that needs nothing else."""
