"""System files: what TOML may say, and the System or Problem made of it."""
