"""Folders of the checkout."""

from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
DOCS = TOP / "docs"
DATA = TOP / "tests" / "data"
