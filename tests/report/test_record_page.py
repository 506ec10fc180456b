"""The page of records before any fit: every breach with what to do, and each flight its own window and sentence."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.records.plausibility.evidence import Evidence
from bayeschute.records.plausibility.reading import Reading
from bayeschute.records.plausibility.verdict import Finding, Verdict
from bayeschute.report import record_page
from bayeschute.report.record_page import write_record_page

BROKEN = Finding("clock", "steps < 0", "3 s", "0 s", 3.0, "fault", ("a wrong unit", "a gap"), "Look at the clock.")
NEAR = Finding("wind.drift", "drift", "2 m", "1 m", 0.8, "warning")


@pytest.fixture
def asked(monkeypatch):
    """What pictures are drawn of, in place of the pictures."""
    drawn = []
    monkeypatch.setattr(record_page, "plausibility_figure", lambda *given: drawn.append(given))
    monkeypatch.setattr(record_page, "svg_of", lambda figure: "<svg/>")
    return drawn


def verdict(*findings, causes=()):
    e = Evidence(np.arange(3.0), altitude=np.zeros(3))
    return Verdict(e, tuple(Reading(f.law, f.tests, f.excess, f.got, f.wanted) for f in findings), findings, causes)


def test_a_breach_has_its_severity_as_a_class_all_causes_and_what_to_do(asked, tmp_path):
    made = verdict(BROKEN, NEAR, causes=("a wrong unit",))
    page = write_record_page(tmp_path / "page.html", "A & B", {"low": made}).read_text(encoding="utf-8")
    assert '<td class="fault">fault</td>' in page and '<td class="warning">warning</td>' in page
    assert page.count('class="fault"') == 1 and "steps &lt; 0" in page and "A &amp; B" in page
    assert "a wrong unit; or: a gap" in page and "Look at the clock." in page
    assert '<p class="cause">Likely cause: a wrong unit</p>' in page
    cells = [c.split("</td>")[0].split(">")[-1] for c in page.split("<tr>")[2].split("<td")[1:]]
    assert cells[:5] == ["clock", "steps &lt; 0", "3 s", "0 s", "fault"]


def test_every_flight_has_its_own_window_record_and_sentence(asked, tmp_path):
    kept = Verdict(Evidence(np.arange(3.0)), (Reading("clock", "steps", 0.1, "0", "1"),) * 4, ())
    windows, said = {"b": (1.0, 2.0)}, {"b": "The last half."}
    page = write_record_page(
        tmp_path / "p.html", "t", {"a": kept, "b": kept}, ["No pressure."], windows, said, {"a": 3}
    )
    text = page.read_text(encoding="utf-8")
    assert asked == [(kept, None, 3), (kept, (1.0, 2.0), None)]
    assert "All 4 laws" in text and text.index("<h2>b</h2>") < text.index("The last half.")
    assert '<li class="fault">No pressure.</li>' in text
    assert "No record could be read." in write_record_page(tmp_path / "q.html", "t", {}).read_text(encoding="utf-8")
