"""The page: whole in itself, within its size, and text of users stays text."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.errors import InputError
from kickdrift.view.page import bundle, page, write_page
from kickdrift.view.scene import scene_of
from kickdrift.view.stage import Stage
from tests.folders import TOP

MARKUP = "</script><script>alert(1)</script><!-- <b>&amp;"
ASSETS = TOP / "src" / "kickdrift" / "view" / "assets"
LOADS = ("src", "href", "srcset", "action", "data", "poster", "background")
# Names of XML namespaces, and three.js's pages of help in messages to programmers.
NAMES = re.compile(
    r"https?://(www\.w3\.org/\d{4}/\w+|threejs\.org/docs/[^\s\"'`]*|github\.com/mrdoob/three\.js[^\s\"'`]*)"
)


class Parts(HTMLParser):
    """Elements of a page, with the text of its scripts."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.scripts, self.title, self._in = [], [], "", ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self._in = tag

    def handle_endtag(self, tag):
        self._in = ""

    def handle_data(self, text):
        if self._in == "script":
            self.scripts.append(text)
        if self._in == "title":
            self.title += text


def test_text_of_users_cannot_leave_its_place():
    system = kd.System(np.eye(3), species=["A", "</script>", "<i>"], name=MARKUP)
    found = Parts(page(scene_of(system)))
    assert [tag for tag, _ in found.tags].count("script") == 3
    assert not [tag for tag, _ in found.tags if tag in ("b", "i")]
    scene = json.loads(found.scripts[0])
    assert scene["title"] == MARKUP
    assert scene["species"] == ["A", "</script>", "<i>"]
    assert found.title == f"{MARKUP} · kickdrift"


def test_the_sources_set_text_by_text_content():
    for path in (TOP / "src" / "viewer").glob("*.js"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write", text), path


def test_the_page_loads_nothing():
    found = Parts(page(scene_of("two-body")))
    for tag, attributes in found.tags:
        assert not [key for key in attributes if key in LOADS], tag
    policy = next(each["content"] for _, each in found.tags if each.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; ")
    assert "http" not in policy
    assert not re.search(r"https?:", NAMES.sub("", bundle()))
    assert "</script" not in bundle().lower()


def test_the_bundle_names_the_pinned_version_and_has_the_licence():
    pinned = json.loads((TOP / "src" / "viewer" / "package.json").read_text())["devDependencies"]["three"]
    locked = json.loads((TOP / "src" / "viewer" / "package-lock.json").read_text())["packages"]
    assert locked["node_modules/three"]["version"] == pinned
    assert f"three.js {pinned}: MIT" in bundle()[:4000]
    assert len(bundle()) < 700_000
    licence = (ASSETS / "LICENSE-three.txt").read_text()
    assert licence.startswith("The MIT License")
    assert "three.js authors" in licence
    assert f'"{(ASSETS / "LICENSE-three.txt").relative_to(TOP)}"' in (TOP / "pyproject.toml").read_text()


def test_a_thousand_particles_and_five_hundred_frames_take_less_than_five_megabytes():
    system = kd.load("lj-1000")
    rng, found = np.random.default_rng(0), Stage.of(system)
    x = system.state.positions + np.cumsum(rng.normal(0, 0.1, (500, 1000, 3)), axis=0)
    v = rng.normal(size=(500, 1000, 3))
    chunk = found.chunk(range(500), np.arange(500) * 0.1, x, v)
    assert len(page(found.scene([chunk], x[0], v[0]))) < 5_000_000


def test_the_command_writes_a_page_and_replaces_only_pages(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["view", "two-body"], catch_exceptions=False)
    assert done.stdout.splitlines()[0] == "two-body.html"
    first = (tmp_path / "two-body.html").read_text()
    assert first.startswith("<!DOCTYPE html>")
    with pytest.raises(InputError, match=r"two-body.html: exists already"):
        write_page("two-body", "two-body.html")
    assert write_page("two-body", "two-body.html", colour="speed", overwrite=True).read_text() != first
    (tmp_path / "mine.html").write_text("<p>mine</p>")
    with pytest.raises(InputError, match=r"mine.html: is not a view that kickdrift wrote; it is not replaced"):
        write_page("two-body", "mine.html", overwrite=True)
    with pytest.raises(InputError, match=r"view.png: the name of a view must end in .html"):
        write_page("two-body", "view.png")
