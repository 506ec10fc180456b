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
    (note,) = notes((*FORCES[:2], replace(FORCES[2], source=f"x; {stage_fit.settled_terms.TAKEN_BACK}")))
    assert note == "all: the search of terms had left out transverse[c], which a flight demands."


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


@pytest.mark.parametrize("outcome", ["nothing", "once", "always", "lost at rest", "lost about it"])
def test_a_fit_takes_back_terms_until_none_is_demanded_and_keeps_the_largest_that_ends(monkeypatch, outcome):
    began, ended, revised, said = [], [], [], []
    flight = SimpleNamespace(name="one")
    groups = [
        Group("all", (flight,), tuple(Prior(f"p{k}", 0.0, 1.0, False, "1", "x") for k in range(1 + i)))
        for i in range(4)
    ]

    def mode_and_noise(flights, priors, prior, place, say):
        began.append((len(priors), place))
        if outcome == "lost at rest" and len(priors) > 1:
            raise FloatingPointError("a step fails")
        return f"rest of {len(priors)}"

    def about_mode(flights, priors, prior, place, say, widen):
        assert place == f"rest of {len(priors)}" and widen
        ended.append(len(priors))
        if outcome == "lost about it" and len(priors) > 1:
            raise FitError("no mode")
        return f"fit of {len(priors)}"

    def with_demanded(job, asked, group, place, prior):
        assert asked is groups[0] and place == f"rest of {len(group.priors)}"
        more = {"nothing": 0, "once": 1}.get(outcome, 9)
        return (groups[len(group.priors)], f"place {len(group.priors)}") if len(group.priors) <= more else None

    monkeypatch.setattr(stage_fit.assemble, "noise_prior", lambda study: None)
    monkeypatch.setattr(stage_fit, "data_of", lambda job, flight, priors: flight)
    monkeypatch.setattr(stage_fit, "mode_and_noise", mode_and_noise)
    monkeypatch.setattr(stage_fit, "about_mode", about_mode)
    monkeypatch.setattr(stage_fit.checkpoint, "get_settled", lambda job, name: None)
    monkeypatch.setattr(stage_fit.checkpoint, "put_settled", lambda *given: None)
    monkeypatch.setattr(stage_fit.settled_terms, "settle", lambda job, group, prior, say: (groups[0], "settled", {}))
    monkeypatch.setattr(stage_fit.settled_terms, "with_demanded", with_demanded)
    monkeypatch.setattr(stage_fit.settled_terms, "revise", lambda job, priors: revised.append(len(priors)))
    job = SimpleNamespace(study=SimpleNamespace(noise=SimpleNamespace(model="latent")))
    group, found, _ = stage_fit._found(job, groups[0], lambda share, words: said.append(words))
    most = 1 + stage_fit._TAKEN_BACK
    size, tried = {"once": (2, [2]), "always": (most, [most]), "lost about it": (1, [*range(most, 0, -1)])}.get(
        outcome, (1, [1])
    )
    assert len(group.priors) == size and found == f"fit of {size}" and ended == tried
    assert revised == ([size] if size > 1 else [])
    assert began == [(1, "settled"), *((n + 1, f"place {n}") for n in range(1, len(began)))]
    assert sum("a flight demands" in words for words in said) == len(began) - 1
    assert ("without them: a step fails" in said) == (outcome == "lost at rest")
    assert sum("without the terms taken back: no mode" in words for words in said) == len(ended) - 1
