"""What textbooks and web guides say of integrators: a script for each topic."""
