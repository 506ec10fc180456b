"""What `Flight.plausibility` returns: the worst law first, and a breach that is accepted is no fault of the flight."""

from __future__ import annotations

import numpy as np

from bayeschute.api.views.plausibility import Plausibility
from bayeschute.records.plausibility.evidence import Evidence
from bayeschute.records.plausibility.reading import Reading
from bayeschute.records.plausibility.verdict import Finding, Verdict

READINGS = tuple(
    Reading(law, f"tests {law}", x, f"got {x}", "wanted")
    for law, x in (("clock", 0.1), ("wind.drift", 5.0), ("wind.share", 0.8), ("pull.size", 2.0))
)
FAULTS = tuple(
    Finding(r.law, r.tests, r.got, r.wanted, r.excess, "fault", causes, do)
    for r, causes, do in (
        (READINGS[1], ("wrong unit", "other"), "Say ft."),
        (READINGS[3], ("wrong unit",), "Not this."),
    )
)
NEAR = Finding("wind.share", "tests wind.share", "got 0.8", "wanted", 0.8, "warning")


def looked(*findings, accepted=(), causes=(), noise=()):
    return Plausibility("a", Verdict(Evidence(np.arange(3.0)), READINGS, findings, causes), None, accepted, noise)


def test_the_worst_law_comes_first_and_says_what_it_is():
    table = looked(*FAULTS, NEAR).table
    assert table.index.tolist() == ["wind.drift", "pull.size", "wind.share", "clock"]
    assert table["severity"].tolist() == ["fault", "fault", "warning", ""]
    assert table["likely cause"].tolist() == ["wrong unit", "wrong unit", "", ""]
    row = table.loc["pull.size"]
    assert (row["tests"], row["got"], row["wanted"], row["excess"]) == ("tests pull.size", "got 2.0", "wanted", 2.0)


def test_every_fault_must_be_accepted_by_its_name_or_its_group():
    assert looked(NEAR).ok and not looked(*FAULTS).ok
    assert not looked(*FAULTS, accepted=("wind",)).ok and looked(*FAULTS, accepted=("wind", "pull.size")).ok
    assert not looked(*FAULTS, accepted=("wind.share", "pull")).ok


def test_a_cause_is_told_with_what_to_do_of_the_first_finding_that_has_it():
    said = repr(looked(*FAULTS, NEAR, causes=("wrong unit", "unknown"), noise=("too small",))).splitlines()
    assert said == [
        "Plausibility of a: 2 faults, 1 warning",
        "  likely: wrong unit. Say ft.",
        "  likely: unknown.",
        "  fault: tests wind.drift: got 5.0, wanted wanted",
        "  fault: tests pull.size: got 2.0, wanted wanted",
        "  warning: tests wind.share: got 0.8, wanted wanted",
        "  noise: too small",
    ]
    assert repr(looked(noise=("x",))) == "Plausibility of a: 4 laws kept\n  noise: x"
    html = looked(*FAULTS, causes=("wrong unit",), noise=("too small",))._repr_html_()
    assert "<p>likely: wrong unit; too small</p>" in html and "<td>0.1</td>" in html
