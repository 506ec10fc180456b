"""Proposals for terms: found where they are, by chance as often as promised, and blind to what the model has."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.posterior.assess.latent_terms import proposals, variance_of_product


def slow(rng, shape, memory=20.0):
    """Stationary AR(1) series (..., T) of unit variance."""
    phi = np.exp(-1.0 / memory)
    x = rng.standard_normal(shape)
    for t in range(1, shape[-1]):
        x[..., t] = phi * x[..., t - 1] + np.sqrt(1.0 - phi**2) * x[..., t]
    return x


@pytest.mark.parametrize("together", [0.0, 0.8])
def test_the_variance_of_a_product_is_that_of_many(together):
    """Components that share their gusts, and a regressor in which two canopies do the same."""
    rng, root = np.random.default_rng(1), np.linalg.cholesky([[1.0, together], [together, 1.0]])
    x = np.repeat(slow(rng, (1, 900), 60.0), 2, axis=0)
    many = [root @ slow(rng, (2, 900)) for _ in range(300)]
    wanted = np.var([float(np.sum(x * y)) for y in many])
    found = np.mean([variance_of_product(y, x) for y in many])
    assert found == pytest.approx(wanted, rel=0.25)


def test_a_term_that_is_missing_comes_first_with_its_coefficient():
    rng = np.random.default_rng(2)
    x, other, base = slow(rng, (3, 4, 900))
    found = proposals([0.3 * x + 0.05 * slow(rng, (4, 900))], {"base": [base]}, {"other": [other], "x": [x]})
    assert found[0].term == "x" and found[0].share > 0.8 and found[0].p_any < 1e-4
    assert found[0].coefficient == pytest.approx(0.3, abs=0.03)
    assert found[1].term == "other" and found[1].p_any > 0.01


@pytest.mark.parametrize(("length", "memory"), [(900, 20.0), (250, 30.0)])
def test_chance_reaches_a_level_as_often_as_it_says(length, memory):
    """A record of 90 s, and one of 25 s whose latent force remembers 3 s."""
    rng, p = np.random.default_rng(3), []
    for _ in range(300):
        y, x, base = slow(rng, (3, 2, length), memory)
        (one,) = proposals([y], {"base": [base]}, {"x": [x]})
        p.append(one.p_value)
    assert np.mean(np.array(p) < 0.05) < 0.1 and np.mean(np.array(p) < 0.01) < 0.04
    assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.15)


def test_white_noise_standard_errors_would_cry_wolf():
    """The same series, their memory ignored: half of them would be called significant at 5 %."""
    rng = np.random.default_rng(3)
    z = [float(np.sum(a * b) / np.sqrt(np.sum(a**2))) for a, b in slow(rng, (200, 2, 900))]
    assert np.mean(np.abs(z) > 1.96) > 0.4


def test_what_the_terms_of_the_model_make_is_no_proposal():
    rng = np.random.default_rng(4)
    a, b = slow(rng, (2, 2, 500))
    found = proposals([a + 0.1 * b], {"a": [a], "b": [b]}, {"sum": [2.0 * a - b], "a again": [a]})
    assert found == []


def test_a_candidate_counts_with_what_is_new_in_it():
    rng = np.random.default_rng(5)
    a, new = slow(rng, (2, 2, 2000))
    found = proposals([new], {"a": [a]}, {"mixed": [10.0 * a + new]})
    assert found[0].share > 0.95 and found[0].coefficient == pytest.approx(1.0, abs=0.05)


def test_several_flights_speak_together():
    rng = np.random.default_rng(6)
    x = [slow(rng, (2, 300)), slow(rng, (4, 500))]
    noise = [slow(rng, (2, 300)), slow(rng, (4, 500))]
    one = proposals([x[0] + noise[0]], {}, {"x": x[:1]})[0]
    both = proposals([a + b for a, b in zip(x, noise, strict=True)], {}, {"x": x})[0]
    assert abs(both.z) > abs(one.z) and both.share == pytest.approx(0.5, abs=0.2)


def test_without_a_latent_force_there_is_nothing_to_propose():
    assert proposals([np.zeros((2, 50))], {}, {"x": [np.ones((2, 50))]}) == []
