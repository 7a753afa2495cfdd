"""Views of Systems, Simulations and runs: pages outside of notebooks, widgets inside."""

from __future__ import annotations

import builtins
import json
import sys
from html.parser import HTMLParser

import pytest

import kickdrift as kd
from kickdrift.view import page, views
from kickdrift.view.packing import unpacked
from tests.systems import liquid


class Frames(HTMLParser):
    """Collects the attributes of frames."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[dict[str, str | None]] = []

    def handle_starttag(self, tag, attrs):
        self.found += [dict(attrs)] if tag == "iframe" else []


def test_a_view_is_a_page_that_can_be_saved(tmp_path):
    system = liquid()
    sim = kd.Simulation(system, dt=0.001)
    sim.run(3, every=1, output=tmp_path / "run.h5md")
    with kd.open(tmp_path / "run.h5md") as run:
        found = {"system": system.view(), "sim": sim.view(), "run": run.view(height=300)}
    assert "frames 4" in repr(found["run"])
    parser = Frames()
    parser.feed(found["run"]._repr_html_())
    (frame,) = parser.found
    assert "height: 300px" in (frame["style"] or "")
    assert frame["sandbox"] == "allow-scripts allow-downloads"
    assert (frame["srcdoc"] or "").startswith("<!DOCTYPE html>")
    for name, view in found.items():
        path = view.save(tmp_path / f"{name}.html")
        assert path.read_text() == page.page(view.scene)
        with pytest.raises(kd.InputError, match="exists"):
            view.save(path)
    assert unpacked(found["sim"].scene["chunks"][0]["steps"]).tolist() == [3]
    assert sim.followers == []


def test_a_title_with_markup_stays_inside_its_attribute():
    system = liquid()
    named = kd.System(system.state.positions, box=system.box, name='"><script>alert(1)</script>', forces=())
    parser = Frames()
    text = named.view()._repr_html_()
    parser.feed(text)
    assert len(parser.found) == 1
    assert parser.found[0]["title"] == '"><script>alert(1)</script>'
    assert "<script" not in text


def test_a_widget_follows_its_simulation(monkeypatch):
    pytest.importorskip("anywidget")
    monkeypatch.setattr(views, "in_notebook", lambda: True)
    sim = kd.Simulation(liquid(), dt=0.001)
    widget = sim.view(height=250)
    sent = []
    monkeypatch.setattr(widget, "send", sent.append)
    sim.run(20, every=5)
    assert widget.live
    assert widget.height == 250
    kinds = [each["kind"] for each in sent]
    assert {"told", "frame"} <= set(kinds)
    assert kinds[-1] == "end"
    assert sent[-3]["content"]["text"] == "finished at step 20"
    scene = json.loads(widget.scene)
    assert unpacked(scene["chunks"][0]["steps"]).tolist() == [20]
    assert "export default" in widget._esm
    still = liquid().view()
    assert not still.live


def test_without_anywidget_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(views, "in_notebook", lambda: True)
    monkeypatch.delitem(sys.modules, "kickdrift.view.widget", raising=False)
    before = builtins.__import__

    def missing(name, *given, **more):
        if name == "anywidget":
            raise ImportError(name)
        return before(name, *given, **more)

    monkeypatch.setattr(builtins, "__import__", missing)
    view = kd.Simulation(liquid(), dt=0.001).view()
    assert isinstance(view, page.View)
    assert capsys.readouterr().err.count("\n") == 1
    liquid().view()
    assert capsys.readouterr().err == ""


def test_a_problem_has_no_view():
    with pytest.raises(kd.InputError, match="a Problem has no particles"):
        kd.Simulation(kd.load("ode-harmonic")).view()


def test_no_program_outside_of_a_notebook_gets_widgets():
    assert not views.in_notebook()
