"""Figures, drawn without pyplot, so that nothing outside the figure changes."""
