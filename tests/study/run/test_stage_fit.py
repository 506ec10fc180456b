"""The stage `fit`: what it says of a fit beside its numbers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.core.errors import FitError
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.fit.joint_fit import NoFitError
from bayeschute.posterior.sampling.protocol import Draws
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


@pytest.mark.parametrize(
    ("model", "do"), [("latent", "a shorter window"), ("ar1", 'model = "latent"'), ("sandwich", 'model = "latent"')]
)
def test_a_fit_without_an_optimum_says_what_to_do_and_where_it_ended(model, do):
    job = SimpleNamespace(study=SimpleNamespace(noise=SimpleNamespace(model=model)))
    best = SimpleNamespace(flights=(), theta=np.array([0.2, -0.1, 0.3]), covariance=np.diag([0.01, 0.04, 0.09]))
    error = NoFitError("the search did not end", ["first way"], best, FORCES, None)
    told = stage_fit._with_paths(job, Group("all", (), ()), error)
    assert told.reason.startswith("fit of all: the search did not end; ") and do in told.reason
    assert told.tried == ("first way",) and told.paths == ()
    assert told.parameters[1] == ("transverse[e]", -0.1, pytest.approx(0.2), "1")
    other = FitError("of another kind")
    assert stage_fit._with_paths(job, Group("all", (), ()), other) is other


def _drawn(xi):
    return Draws(xi, np.zeros(xi.shape[:2]), notes=("a note",))


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("sandwich", 'vary in 0 of 3 directions: the standard errors of output error .*model = "latent"'),
        ("nuts", "vary in 0 of 3 directions: walks did not leave where they began; fit a shorter window"),
    ],
)
def test_draws_that_are_no_posterior_are_refused(kind, says):
    """Forecasts begin from the draws' covariance, which has no factor there."""
    job = SimpleNamespace(study=SimpleNamespace(noise=SimpleNamespace(model="latent")))
    marginal = SimpleNamespace(centre=np.array([1.0, 2.0, 3.0]), scale=0.1 * np.eye(3))
    xi = np.random.default_rng(0).standard_normal((2, 500, 3))
    stage_fit._refuse_a_place(job, Group("all", (), ()), marginal, _drawn(xi), kind)
    with pytest.raises(FitError, match=says) as refused:
        stage_fit._refuse_a_place(job, Group("all", (), ()), marginal, _drawn(1e-18 * xi), kind)
    assert refused.value.tried == (f"all: {kind}, 2 chains of 500 draws", "a note")
