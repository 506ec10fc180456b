"""A posterior of populations whose draws diverged: its checks, its level of trust, and what is foretold by it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from bayeschute.report.run_results import Results
from bayeschute.report.tables.trust_tables import check_table, warnings_of
from bayeschute.study.assembly.populations import DIVERGING
from bayeschute.study.evidence.divergent_transitions import divergences_check


@pytest.fixture
def diverged(posterior):
    """The same posterior with the check of draws of which a fifth of the transitions diverged."""
    stored = json.loads(posterior.files["checks.json"])
    stored["checks"] |= divergences_check({DIVERGING: np.arange(400) % 5 == 0})
    return replace(posterior, files={**posterior.files, "checks.json": json.dumps(stored).encode()})


def test_checks_trust_and_forecasts_know_it(posterior, diverged, sondes):
    assert "divergences" not in posterior.checks().index
    row = diverged.checks().loc["divergences"]
    assert not row["passed"] and row["value"] == 0.2 and row["wanted"] == "at most 0.0100"
    assert not diverged.passed and "divergences" in diverged.failed_checks
    assert "divergences" in diverged.trust.lacking[0] and "divergences" in repr(diverged)
    assert "divergences" in diverged.predict(sondes.flights["low"]).failed_checks


def test_the_report_tells_it_once(tmp_path):
    checks = divergences_check({DIVERGING: np.ones((2, 5), bool)})
    summary = {"checks": checks, "sampling": {"divergences": 10, "failed_solves": 0}}
    results = Results(tmp_path, summary, {}, {}, {}, {}, {}, {}, ())
    (line,) = warnings_of(results)
    assert line.startswith("Failed check: 10 of 10 transitions")
    table = check_table(results)
    assert table is not None and [cell.text for cell in table.rows[0]][3:] == ["at most 0.0100", "failed"]
