"""Bounds of checks with their sense."""

from __future__ import annotations

import json

from bayeschute.report.check_words import wanted


def test_bounds_have_a_sense():
    assert wanted("rhat", 1.01) == "at most 1.01" and wanted("innovations", 0.9) == "near 0.900"
    assert wanted("rhat", None) == "" and wanted("one of its own", 2.0) == "2.00"


def test_every_check_of_a_run_has_one(finished):
    checks = json.loads((finished.folder / "summary.json").read_text(encoding="utf-8"))["checks"]
    said = {name: wanted(name, one["bound"]) for name, one in checks.items()}
    assert len(said) >= 10 and all(text.split()[0] in {"at", "above", "below", "near"} for text in said.values()), said
