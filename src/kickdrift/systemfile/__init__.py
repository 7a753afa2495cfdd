"""System files: the TOML schema, and the System or Problem made from a file."""
