"""The JSON schema of system files: shipped files fit, and what the loader refuses by type the schema refuses too."""

from __future__ import annotations

import copy
import json
import warnings

import jsonschema
import pytest

from kickdrift.errors import InputError
from kickdrift.systemfile.files import shipped
from kickdrift.systemfile.json_schema import NAME, NAMED, json_schema
from kickdrift.systemfile.reading import built
from kickdrift.systemfile.templates import kinds, template
from tests.broken_files import MISSING, UNKNOWN, WRONG, broken, shipped_tables
from tests.folders import TOP
from tests.processes import python

SYSTEMS = TOP / "systems"
SCHEMA = json_schema()
VALID = jsonschema.Draft7Validator(SCHEMA)
CASES = [case for name, whole in shipped_tables().items() for case in broken(name, whole)]


def refusal(tables: dict) -> str | None:
    """The loader's line, or None."""
    try:
        with warnings.catch_warnings(action="ignore"):
            built(copy.deepcopy(tables), "file", None, SYSTEMS)
    except InputError as error:
        return str(error)
    return None


def test_the_schema_is_a_schema():
    jsonschema.Draft7Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_file_names_the_schema_and_fits(name):
    assert shipped()[name].read_text(encoding="utf-8").startswith(f"{NAMED}\n")
    VALID.validate(shipped_tables()[name])


@pytest.mark.parametrize("kind", kinds())
def test_a_new_file_fits(kind):
    import tomllib

    VALID.validate(tomllib.loads(template(kind)))


OF_SEVERAL_KEYS = "one for each particle of the molecule"  # rules between keys, which the schema does not have


@pytest.mark.parametrize("spread", [23, pytest.param(3, marks=pytest.mark.long)])
def test_what_the_loader_refuses_by_type_the_schema_refuses(spread):
    """Every 23rd of the mistakes, and with the long tests every third one: over two hundred."""
    refused = {UNKNOWN: 0, WRONG: 0, MISSING: 0}
    for where, kind, tables in CASES[::spread]:
        line, fits = refusal(tables), VALID.is_valid(tables)
        if line is None:
            assert fits, f"{where}, {kind}: the loader takes what the schema refuses"
        elif line.endswith(OF_SEVERAL_KEYS):
            continue
        elif kind != MISSING or line.endswith("required key is missing"):  # else a rule between keys
            assert not fits, f"{where}, {kind}: the loader says {line}"
            refused[kind] += 1
    assert sum(refused.values()) >= (200 if spread == 3 else 30)
    assert min(refused.values()) > 0


def test_text_is_a_quantity_only_with_a_unit():
    tables = shipped_tables()["argon-864"]
    for text, fits in (("3.4 angstrom", True), ("1e-1nm", True), ("3.4", False), ("long", False), ("", False)):
        tables["force"][0]["sigma"] = text
        assert VALID.is_valid(tables) is fits, text
        assert (refusal(tables) is None) is fits, text


def test_the_stored_schema_has_the_keys_of_today():
    """Another version of pydantic may order the schema in another way, so that keys and names are compared."""
    found = python("from kickdrift.systemfile.json_schema import json_schema_text; print(json_schema_text())")
    stored = json.loads((SYSTEMS / NAME).read_text(encoding="utf-8"))
    assert keys(stored) == keys(json.loads(found.stdout)), f"kickdrift schema > systems/{NAME}"


def keys(part: object, path: str = "") -> set[str]:
    """Path of each key, with its required keys and allowed values."""
    if isinstance(part, list):
        return set().union(*(keys(each, path) for each in part)) if part else set()
    if not isinstance(part, dict):
        return set()
    found = {f"{path} {word} {part[word]}" for word in ("const", "enum", "required", "pattern") if word in part}
    named = (part.get("properties") or {}).get("type", {})
    path = f"{path}/{named.get('const', '')}" if isinstance(named, dict) else path
    for key, each in part.items():
        found |= {f"{path}/{key}"} | keys(each, f"{path}/{key}")
    return found
