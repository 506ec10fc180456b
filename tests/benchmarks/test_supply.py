"""The lock holds what pyproject.toml declares and constraints.txt says; licences are read as packages write them."""

from __future__ import annotations

import re
import tomllib
from email.message import Message
from importlib.metadata import PackageNotFoundError

import pytest
import supply
from packaging.markers import Marker
from packaging.requirements import Requirement

LOCKED = list(supply.pinned(supply.LOCK.read_text(encoding="utf-8")))


def _metadata(**given):
    made = Message()
    for name, values in given.items():
        for value in [values] if isinstance(values, str) else values:
            made[name.replace("_", "-")] = value
    return made


def _of_python(marker, version):
    return not marker or Marker(marker).evaluate({"python_version": version, "python_full_version": f"{version}.4"})


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_the_lock_has_every_declared_package_within_its_bounds_for_every_python(version):
    declared = tomllib.loads((supply.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    held = {name: number for name, number, marker, _ in LOCKED if _of_python(marker, version)}
    for one in map(Requirement, declared):
        if one.marker is None or _of_python(str(one.marker), version):
            assert held[supply.same_name(one.name)] in one.specifier


def test_the_lock_has_the_versions_of_the_constraints_and_a_hash_for_each():
    lines = (supply.ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    wanted: dict[str, set[str]] = {}
    for one in (Requirement(line) for line in lines if line and not line.startswith("#")):
        wanted.setdefault(supply.same_name(one.name), set()).update(spec.version for spec in one.specifier)
    for name, version, _, hashes in LOCKED:
        assert hashes > 0, name
        assert version in wanted.get(name, {version}), name  # a platform's own packages are in no environment here
    assert len({name for name, *_ in LOCKED} & set(wanted)) > 40


@pytest.mark.parametrize(
    ("given", "licence", "permissive"),
    [
        ({"License_Expression": "BSD-3-Clause AND MIT", "License": "other"}, "BSD-3-Clause AND MIT", True),
        ({"License_Expression": "Apache-2.0 OR GPL-3.0-only"}, "Apache-2.0 OR GPL-3.0-only", True),
        ({"License_Expression": "(MIT OR GPL-2.0) AND GPL-3.0-only"}, "(MIT OR GPL-2.0) AND GPL-3.0-only", False),
        ({"License": "MPL-2.0 AND MIT"}, "MPL-2.0 AND MIT", False),
        ({"License": "Copyright (c) 2001", "Classifier": ["License :: OSI Approved :: BSD License"]}, "BSD", True),
        ({"Classifier": ["License :: OSI Approved", "Topic :: MIT License"]}, "unknown", False),
        ({"License": "ISC License"}, "ISC", True),
        ({}, "unknown", False),
    ],
)
def test_a_licence_is_read_as_packages_write_it(given, licence, permissive):
    said = supply.licence_of(_metadata(**given))
    assert (said, supply.is_permissive(said)) == (licence, permissive)


def test_every_package_here_has_a_licence_that_is_permissive_or_explained():
    try:
        found = supply.licences()
    except PackageNotFoundError as error:
        pytest.skip(f"{error} is not installed here")
    assert {"numpy", "jaxlib", "scipy"} <= {one.package for one in found}
    assert [one for one in found if not one.permissive and not one.note] == []


def test_installs_are_compared_in_standard_deviations():
    rows = [
        {"parameters": {"a": [1.0, 0.5], "b": [2.0, 1.0]}},
        {"failed": "run"},
        {"parameters": {"a": [1.1, 9.0], "b": [2.3, 9.0]}},
    ]
    assert supply.apart(rows) == pytest.approx(0.3)
    assert not supply.apart(rows[:2]) >= 0.0


def test_the_shipped_page_is_that_of_the_stored_files():
    installs, found = supply.stored("installs"), supply.stored("licences")
    text = supply.PAGE.read_text(encoding="utf-8")
    assert text == supply.page(installs, found), "python benchmarks/supply.py page"
    assert installs is not None and found is not None
    assert not re.search("failed|unknown|not explained", text)
    assert supply.apart(installs["rows"]) < 0.5
