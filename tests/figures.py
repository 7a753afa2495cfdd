"""Figures that plots save."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import pytest


def saved_by(monkeypatch: pytest.MonkeyPatch, plots: ModuleType) -> list[Any]:
    """A list that gets each figure that this module saves."""
    figures: list[Any] = []
    save = plots.save_figure

    def keep(figure, target, *more):
        figures.append(figure)
        return save(figure, target, *more)

    monkeypatch.setattr(plots, "save_figure", keep)
    return figures
