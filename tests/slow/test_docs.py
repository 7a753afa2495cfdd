"""The documentation: its pages' code runs as it stands, and the site is built from all pages."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import pytest
import yaml

import kickdrift as kd
from tests import pages
from tests.folders import DOCS, TOP

PAGES = sorted(set(DOCS.rglob("*.md")) - {DOCS / "paper.md"})  # the paper is no page of the site
WITH_CODE = [page for page in PAGES if any(b.language in ("python", "sh") for b in pages.blocks(page))]
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.py"))
MADE = {"report.md", "command-line.md", "gallery.md", *(f"notebooks/{each.stem}.md" for each in NOTEBOOKS)}  # by hooks
APART = {"first-hour"}  # pages whose blocks a reader copies one by one


@pytest.mark.long
@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.stem)
def test_a_page_runs(page, tmp_path):
    """Run the page in its own process, like a reader; what the page registers stays there."""
    guesses = "ignore:Element information is missing"  # warning of MDAnalysis on reduced units
    apart = ["--apart"] if page.stem in APART else []
    command = [sys.executable, "-W", "error", "-W", guesses, "-m", "tests.pages", page, *apart]
    path = os.pathsep.join([str(TOP), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr


def test_a_page_that_does_not_run_fails(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text(
        '```python title="one.py"\nx = 2\n```\n```python\nfrom one import x\ny = x\n```\n', encoding="utf-8"
    )
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")
    monkeypatch.syspath_prepend("")
    assert pages.run(page)["y"] == 2
    page.write_text("```sh\nkickdrift run no-such-system\n```\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="no-such-system ended with 2"):
        pages.run(page)


def test_every_page_stands_in_the_site():
    text = re.sub(r"!!\S+", "", (TOP / "mkdocs.yml").read_text(encoding="utf-8"))

    def leaves(entry):
        if isinstance(entry, str):
            return [entry]
        return [leaf for inner in (entry.values() if isinstance(entry, dict) else entry) for leaf in leaves(inner)]

    pages_there = {page.relative_to(DOCS).as_posix() for page in PAGES}
    assert sorted(leaves(yaml.safe_load(text)["nav"])) == sorted(pages_there | MADE)


def test_the_reference_has_every_public_name():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    named = {path.rpartition(".")[2] for path in re.findall(r"^::: (\S+)$", text, flags=re.MULTILINE)}
    assert named == (set(kd.__all__) | set(kd.analysis.__all__)) - {"analysis", "__version__"}


@pytest.mark.long
def test_the_site_is_built(tmp_path):
    """Build strictly: a dead link, an unlisted page or an unknown name is an error. Nothing is fetched. Notebooks
    are not executed here."""
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path / "site"]
    done = subprocess.run(
        command,
        cwd=TOP,
        capture_output=True,
        text=True,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1", "KICKDRIFT_NOTEBOOKS": "source"},
    )
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    for name, words in {
        "api.html": "momentum_error",
        "command-line.html": "--integrator",
        "index.html": "Lennard-Jones",
        "notebooks/first_hour.html": "first_hour.ipynb",
        "gallery.html": "two-worlds.png",
    }.items():
        assert words in (site / name).read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("script", NOTEBOOKS, ids=lambda script: script.stem)
def test_a_notebook_runs_and_ends_in_a_picture(script):
    """Execute the notebook as the site's build does: its last cell draws."""
    pytest.importorskip("nbclient")
    code = f"import json, notebook_pages; print(json.dumps(notebook_pages.executed({script.stem!r})))"
    path = os.pathsep.join([str(DOCS), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    *_, last = json.loads(done.stdout)["cells"]
    assert any("image/png" in output.get("data", {}) for output in last["outputs"])
