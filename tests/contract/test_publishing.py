"""What a publication needs: one list of requirements and one version everywhere, and a paper in the form of JOSS."""

import re
import tomllib

from tests.folders import TOP

PROJECT = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECIPE = (TOP / "conda" / "meta.yaml").read_text(encoding="utf-8")
PAPER = (TOP / "docs" / "paper.md").read_text(encoding="utf-8")
NAMES = {"matplotlib-base": "matplotlib"}  # in conda -> on PyPI


def test_the_recipe_has_the_requirements_of_the_package():
    run = RECIPE.partition("  run:\n")[2].partition("\n\n")[0]
    found = [re.sub(r"^\s*- ", "", line) for line in run.splitlines()]
    names = {NAMES.get(name, name) + bound for name, bound in (line.split() for line in found)}
    assert names == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}


def test_one_version_everywhere():
    version = PROJECT["version"]
    assert f'{{% set version = "{version}" %}}' in RECIPE
    assert f"\nversion: {version}\n" in (TOP / "CITATION.cff").read_text(encoding="utf-8")


def test_the_paper_has_the_parts_of_joss():
    heads = re.findall(r"^# (.+)$", PAPER, flags=re.MULTILINE)
    assert {"Summary", "Statement of need", "References"} <= set(heads)
    cited = set(re.findall(r"@(\w+)", PAPER))
    known = set(re.findall(r"^@\w+\{(\w+),", (TOP / "docs" / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE))
    assert cited == known
    assert 250 <= len(PAPER.split()) <= 1750


def test_figures_of_the_paper_are_there():
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", PAPER):
        assert (TOP / "docs" / name).is_file(), name
