"""The README's Python runs as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_python_of_the_readme_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict = {"__name__": "readme"}
    exec(compile("\n".join(blocks), str(README), "exec"), names)
    report = names["report"]
    assert capsys.readouterr().out.startswith(str(report.energy.rms_relative_error))
    assert report.energy.verdict == "bounded"
    assert abs(report.temperature - 1.0) < 0.05
