"""What curves are called, told in one place and the same in its table, and told without JAX."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from bayeschute.aero import curve_names
from bayeschute.aero.curve_names import ANGLE, CURVES
from bayeschute.aero.published_curve import CURVES as PUBLISHED


def test_the_table_of_the_module_says_what_the_names_say():
    rows = re.findall(r"^\| ``(\w+)`` \| (\w+) \[(\w+)\] \| (.+) \|$", curve_names.__doc__, flags=re.M)
    assert [(name, symbol, unit) for name, symbol, unit, _ in rows] == [
        (name, along.symbol, along.unit) for name, along in CURVES.items()
    ]


def test_angles_are_in_radians_and_published_curves_are_over_them():
    assert {along.unit for along in CURVES.values() if along.symbol == ANGLE} == {"rad"}
    assert {name for name, along in CURVES.items() if along.symbol == ANGLE} == {*PUBLISHED}


def test_the_module_imports_nothing_but_typing():
    body = ast.parse(Path(curve_names.__file__).read_text(encoding="utf-8")).body
    assert {one.module for one in body if isinstance(one, ast.ImportFrom)} == {"__future__", "typing"}
    assert not any(isinstance(one, ast.Import) for one in body)
