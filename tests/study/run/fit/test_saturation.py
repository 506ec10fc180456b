"""Flights that are tried with a fitted library: which are lost is known; whose priors may level off, by stand-ins."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly.fits import Group
from bayeschute.study.run.fit import saturation

PLAIN = [Prior(name, 0.3, 1.0, False, "1", "x") for name in ("axial[1]", "transverse[e*alpha^2]")]
LEVEL = [replace(p, centre=0.1, saturation=0.4) for p in PLAIN]
LENGTH = Prior("riser_length", 71.0, 0.5, False, "m", "given")


@pytest.mark.parametrize(
    ("saturate", "vary", "found", "mine", "wanted"),
    [
        ("auto", None, ("coefficients", "saturated"), PLAIN, True),
        ("always", None, ("coefficients", "saturated"), PLAIN, False),
        (None, None, ("coefficients", "saturated"), PLAIN, False),
        ("auto", ("axial[1]",), ("coefficients", "saturated"), PLAIN, False),
        ("auto", None, ("coefficients",), PLAIN, False),  # no equation error in this run
        ("auto", None, ("coefficients", "saturated"), [replace(p, centre=0.2) for p in PLAIN], False),  # a colleague's
        ("auto", None, ("coefficients", "saturated"), LEVEL, False),
    ],
)
def test_only_priors_by_equation_error_are_told_anew(monkeypatch, saturate, vary, found, mine, wanted):
    entries = {"coefficients": PLAIN, "saturated": LEVEL}
    monkeypatch.setattr(saturation, "of_structure", lambda study, told: told)
    study = SimpleNamespace(
        structure=SimpleNamespace(saturate=saturate), priors=SimpleNamespace(vary_canopies=vary), knowledge=()
    )
    job = SimpleNamespace(study=study, load=lambda name: {key: entries[key] for key in found})
    made = saturation.needed(job, Group("all", (), (*mine, LENGTH)))
    assert (made is not None) == wanted
    if made is not None:
        assert made.priors == (*LEVEL, LENGTH) and made.name == "all"


def test_the_share_is_that_of_the_flight_that_loses_most(monkeypatch):
    """Draws follow the posterior, the air is another one in every flight, and the same seed tries the same flights."""
    asked = []

    def predict(made, index, theta, hyper, seed, data_end):
        asked.append((theta, seed))
        assert hyper == ["noise"] and data_end == 5.0
        return SimpleNamespace(failed=(3, 24)[index])

    monkeypatch.setattr(saturation.bands, "predict", predict)
    scale = np.array([[2.0, 0.0], [1.0, 0.5]])
    made = SimpleNamespace(centre=np.array([1.0, -1.0]), scale=scale, flights=("a", "b"))
    assert saturation.lost(made, "noise", 7) == 0.25 == saturation.lost(made, "noise", 7)
    theta, seed = asked[0]
    assert theta.shape == (96, 2) and all(np.array_equal(theta, other) and seed == air for other, air in asked)
    np.testing.assert_allclose(theta.mean(axis=0), made.centre, atol=0.7)
    np.testing.assert_allclose(np.cov(theta.T), scale @ scale.T, rtol=0.5, atol=0.5)
    saturation.lost(made, "noise", 8)
    assert not np.array_equal(asked[-1][0], theta)
