"""The stage `fit`: what it says of a fit beside its numbers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly.fits import Group
from bayeschute.study.run import stage_fit

FORCES = tuple(Prior(name, 0.1, 0.05, False, "1", "x") for name in ("axial[1]", "transverse[e]", "transverse[c]"))
FOUND = SimpleNamespace(lost=(), dispersion=SimpleNamespace(disagree=False))


def test_a_prior_that_the_flights_contradict_is_told():
    def notes(priors):
        return stage_fit._notes(SimpleNamespace(found=FOUND, group=Group("all", (), priors)), True)

    assert notes(FORCES) == []
    (note,) = notes((FORCES[0], *(replace(p, widened=2.345) for p in FORCES[1:])))
    assert "equation error on the transverse force" in note and "2.3 times" in note
