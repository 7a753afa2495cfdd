"""Check of refused commands."""

from __future__ import annotations

from kickdrift.text import MESSAGE


def assert_refused(result, *parts, status=2):
    """Check for one line on standard error with these parts, nothing on standard output, and the exit status."""
    code, out, err = result
    assert code == status, err
    assert out == ""
    assert err.startswith("kickdrift: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert "Traceback" not in err
    assert len(err) < MESSAGE + 50
    for part in parts:
        assert part in err
