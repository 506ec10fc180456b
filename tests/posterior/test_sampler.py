"""Draws by NUTS on a surrogate, and by what takes its place where they fail their check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.posterior import sampler
from bayeschute.posterior.marginal import log_density, projected_residuals, sample_log_likelihoods
from bayeschute.posterior.sampling import independence
from bayeschute.posterior.sampling.independence import Proposal
from bayeschute.posterior.sampling.sampler_checks import why_not_trusted

CHAINS, DRAWS, NAMES = 2, 120, ("first", "second")


@pytest.fixture(scope="module")
def draws(found):
    return sampler.sample(found.marginal, "nuts", CHAINS, 200, DRAWS, seed=1)


def test_draws_are_nearly_standard(draws):
    assert draws.xi.shape == (CHAINS, DRAWS, 1) and draws.failed == 0
    assert abs(draws.xi.mean()) < 0.35 and draws.xi.std() == pytest.approx(1.0, abs=0.2)
    assert draws.stats["acceptance_rate"].mean() > 0.9


def test_draws_carry_their_log_density(found, draws):
    flat = draws.xi.reshape(-1, 1).T
    np.testing.assert_allclose(draws.log_density.ravel(), log_density(found.marginal, flat), atol=1e-8)


@pytest.fixture(scope="module")
def asked(found):
    """emcee's draws, asked for."""
    return sampler.sample(found.marginal, "emcee", 1, 0, 400, seed=2)


def test_emcee_agrees(asked, draws):
    assert asked.xi.shape == (1, 400, 1)
    np.testing.assert_allclose(np.quantile(asked.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


def test_good_draws_come_without_a_word(draws):
    assert draws.notes == () and draws.stats["log_ratio"].shape == (CHAINS, DRAWS)
    assert why_not_trusted(draws) == ""


@pytest.mark.parametrize(
    ("slow", "lengths"),
    [
        ((1.1, 0.9), (2,)),
        ((3.0, 0.9), (4,)),
        ((3.0, 1.2, 5.0), (4, 8)),
        ((30.0, 2.0), (16,)),
        ((3.0, 9.0), (4,)),
        ((40.0,), ()),
        ((1.7e308,), ()),
    ],
)
def test_a_walk_that_mixes_slowly_is_made_as_long_as_it_takes(found, draws, slow, lengths, monkeypatch):
    """And not at all where even the longest would have to be longer still."""
    verdicts, heard = iter(slow), []
    monkeypatch.setattr(sampler, "slowness", lambda made, scale: next(verdicts))
    other = sampler.sample(
        found.marginal, "nuts", CHAINS, 200, DRAWS, 2, lambda share, words: heard.append(words.split(":")[0])
    )
    assert other.notes == () and other.xi.shape == draws.xi.shape and why_not_trusted(other) == ""
    assert list(dict.fromkeys(heard)) == ["nuts", *(f"nuts, {n} times as long" for n in lengths)]
    more = [16 * (1 + 20 + n * DRAWS // (16 // CHAINS)) for n in lengths]  # 16 walks: their starts, warm-up and steps
    assert other.evaluations == draws.evaluations + sum(more)
    np.testing.assert_allclose(np.quantile(other.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


@pytest.fixture
def broken(monkeypatch):
    """A surrogate whose density is three times too narrow: NUTS on it sticks (k of the ratios is 8/9).

    The draws of a study (4 chains of 500) notice with twelve seeds of twelve, 2 of 300 with eleven.
    """
    build, narrower = sampler.build, ("straight", "mixed", "bent")

    def narrow(*given):
        made, failed = build(*given)
        flights = tuple(one._replace(**{part: 9.0 * getattr(one, part) for part in narrower}) for one in made.flights)
        return replace(made, flights=flights, prior=9.0 * made.prior), failed

    monkeypatch.setattr(sampler, "build", narrow)


def test_a_broken_surrogate_gives_way_to_independent_proposals(found, draws, broken):
    heard = []
    other = sampler.sample(found.marginal, "nuts", 4, 300, 500, 2, lambda share, words: heard.append(words))
    assert len(other.notes) == 1 and "independence sampler drew instead" in other.notes[0]
    assert "Pareto k" in other.notes[0]
    assert "log_ratio" not in other.stats  # they are not the surrogate's draws
    assert any(w.startswith("nuts") for w in heard) and heard[-1].startswith("independence sampler")
    np.testing.assert_allclose(np.quantile(other.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


@pytest.mark.parametrize("lost", [False, True])
def test_broken_proposals_give_way_to_emcee(found, draws, asked, broken, monkeypatch, lost):
    """Proposals a hundred times too narrow, or none at all: emcee on the exact density is the last that is asked."""
    proposal = Proposal(np.zeros(1), np.full((1, 1), 0.01))

    def learned(*_):
        if lost:
            raise FloatingPointError("nothing flies")
        return proposal, np.zeros((8, 1))

    monkeypatch.setattr(independence, "learned", learned)
    other = sampler.sample(found.marginal, "nuts", 1, 200, 400, 2)
    assert len(other.notes) == 1 and "emcee drew instead" in other.notes[0]
    assert ("nothing flies" in other.notes[0]) == lost
    np.testing.assert_array_equal(other.xi, asked.xi)
    assert other.evaluations > asked.evaluations
    np.testing.assert_allclose(np.quantile(other.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


def test_log_likelihood_has_the_normaliser_of_the_filter(found):
    flight, along = found.marginal.flights[0], found.marginal.along[0]
    middle = np.zeros((1, 1))
    rows = np.asarray(sample_log_likelihoods(found.marginal, middle)[0])
    unit = np.asarray(projected_residuals(found.marginal, middle))[: flight.observed.size]
    wanted = (
        -0.5 * np.sum(unit**2) - float(along.gains.log_determinant) - 0.5 * flight.present.sum() * np.log(2 * np.pi)
    )
    assert rows.sum() == pytest.approx(wanted, rel=1e-12)
