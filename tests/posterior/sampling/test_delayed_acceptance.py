"""The exact step of delayed acceptance on proposals that are known: what is taken, kept, laid end to end and told."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from bayeschute.posterior.sampling import delayed_acceptance as module


class State(NamedTuple):
    """A sampler's state as far as it matters here."""

    z: Any
    z_grad: Any
    potential_energy: Any
    diverging: Any
    adapted: Any


def at(z, step):
    z = np.asarray(z, float)
    return State(z, -z, 0.5 * np.sum(z**2, axis=1), np.full(len(z), step % 2 == 0), step)


@pytest.fixture
def proposals(monkeypatch):
    """Proposals by step (streams, P) in place of NUTS's; the start is the first, warmed up the second."""

    def set_up(places):
        monkeypatch.setattr(module, "_begin", lambda *_: at(places(0, None), 0))
        monkeypatch.setattr(
            module, "_advance", lambda f, state, *_: at(places(state.adapted + 1, state.z), state.adapted + 1)
        )

    return set_up


def surrogate(x):
    return -0.5 * np.sum(x**2, axis=0)


def walk(density, chains=2, draws=3, streams=4, **more):
    return module.corrected(density, lambda x: None, 1, chains, 10, draws, 3, streams=streams, **more)


def test_streams_are_laid_end_to_end_thinned_and_cut(proposals):
    """Two streams a chain, three draws: the first after ten steps of settling and one that is passed by."""
    proposals(lambda step, _: 1000.0 * np.arange(4)[:, None] + step)
    told = []
    made = walk(surrogate, thinning=2, progress=lambda *said: told.append(said))
    first, last = 1 + 10 + 2, 1 + 10 + 4  # the start was moved once already, to warm up
    assert made.xi[..., 0].tolist() == [[first, last, 1000 + first], [2000 + first, 2000 + last, 3000 + first]]
    np.testing.assert_allclose(made.log_density, surrogate(made.xi.transpose(2, 0, 1)))
    np.testing.assert_array_equal(made.stats["acceptance_rate"], 1.0)
    assert told[0] == (1, 14) and told[-1] == (14, 14) and made.evaluations == 4 * 15


def test_a_proposal_is_judged_by_the_change_of_the_ratio(proposals):
    """Back and forth between two points: to the one whose ratio of exact to surrogate is 4 times smaller, one in four."""
    proposals(lambda step, z: np.where(z == 1.0, 2.0, 1.0) if z is not None else np.ones((400, 1)))
    ratio = {1.0: np.log(4.0) - 7.0, 2.0: -7.0}
    density = lambda x: surrogate(x) + np.array([ratio[one] for one in x[0]])  # noqa: E731
    made = walk(density, chains=400, draws=50, streams=400)
    here = made.xi[..., 0]
    assert np.mean(here == 1.0) == pytest.approx(0.8, abs=0.02)  # 4 : 1
    proposed = np.where(np.isclose(made.stats["log_ratio"], ratio[1.0]), 1.0, 2.0)
    np.testing.assert_allclose(made.stats["log_ratio"], np.where(proposed == 1.0, ratio[1.0], ratio[2.0]))
    assert set(np.round(np.unique(made.stats["acceptance_rate"]), 9)) == {0.25, 1.0}
    assert ((made.stats["acceptance_rate"] == 1.0) == (proposed == 1.0)).all()


def test_a_walk_that_begins_where_nothing_flies_leaves_at_once_and_does_not_go_back(proposals):
    proposals(lambda step, z: np.full((1, 1), -1.0 if step < 8 or step > 16 else 1.0))
    made = walk(lambda x: np.where(x[0] < 0.0, np.nan, surrogate(x)), chains=1, draws=10, streams=1)
    np.testing.assert_array_equal(made.xi, 1.0)
    assert np.isneginf(made.stats["log_ratio"]).sum() == 5 and made.failed == 1 + 6 + 5
    assert (made.stats["acceptance_rate"] == [[1.0] * 5 + [0.0] * 5]).all()


def test_place_slope_and_density_move_together_and_adaptation_goes_on():
    old, new = at(np.zeros((3, 2)), 4), at(np.ones((3, 2)), 5)
    made = module._take(np.array([True, False, True]), new, old)
    np.testing.assert_array_equal(made.z[:, 0], [1.0, 0.0, 1.0])
    np.testing.assert_array_equal(made.z_grad, -made.z)
    np.testing.assert_array_equal(made.potential_energy, [1.0, 0.0, 1.0])
    assert made.adapted == 5


@pytest.mark.parametrize("warmup", [60, 400])
def test_law_a_normal_of_forty_parameters_is_drawn_in_short_walks(warmup):
    """Variances from 0.5 to 2 and a correlation; a covariance learnt from sixty steps takes hundreds of steps a draw."""
    import jax

    size = 40
    covariance = np.diag(np.linspace(0.5, 2.0, size))
    covariance[0, 1] = covariance[1, 0] = 0.3
    precision = np.linalg.inv(covariance)
    density = jax.tree_util.Partial(_quadratic, precision)
    drawn = module.plain(density, size, 4, warmup, 500, 5)
    xi = drawn.xi.reshape(-1, size)
    assert np.mean(drawn.stats["n_steps"]) < 20.0
    np.testing.assert_allclose(np.mean(xi, axis=0), 0.0, atol=0.2)
    np.testing.assert_allclose(np.cov(xi.T), covariance, atol=0.3)
    assert np.cov(xi.T)[0, 1] == pytest.approx(0.3, abs=0.1)


def _quadratic(precision, xi):
    return -0.5 * xi @ (precision @ xi)
