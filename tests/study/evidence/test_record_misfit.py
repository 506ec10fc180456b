"""Distances of estimates from their priors: standard normal where the prior is right, whatever else widened the draws."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.dynamics.cluster_flight import air_between
from bayeschute.likelihood.priors import Prior
from bayeschute.study.evidence import record_misfit

PRIORS = (Prior("a", 0.3, 0.5, False, "1", "x"), Prior("b", np.log(2.0), 0.2, True, "m", "y"))
RNG = np.random.default_rng(2)


@pytest.fixture
def distances(monkeypatch):
    """Distances of both parameters, from draws of a Gaussian posterior and by how much these were widened."""
    monkeypatch.setattr(record_misfit, "noise_distances", lambda job, one: {})
    group = SimpleNamespace(flights=[SimpleNamespace(name="one")], priors=PRIORS)

    def found(mean, sd, widened=1.0, draws=2000):
        xi = RNG.standard_normal((2, draws, 2))
        one = SimpleNamespace(held=mean + sd * xi, theta=mean + widened * sd * xi)
        return np.array([check.value for check in record_misfit._of_priors(None, group, one)])

    return found


@pytest.mark.parametrize("noise", [0.1, 0.4])
def test_where_the_prior_is_right_the_distance_is_standard_normal(distances, noise):
    z = []
    for _ in range(400):
        truth = np.array([0.3, np.log(2.0)]) + [0.5, 0.2] * RNG.standard_normal(2)
        precision = 1.0 / np.array([0.5, 0.2]) ** 2 + 1.0 / noise**2
        datum = truth + noise * RNG.standard_normal(2)
        mean = (np.array([0.3, np.log(2.0)]) / np.array([0.5, 0.2]) ** 2 + datum / noise**2) / precision
        z.append(distances(mean, 1.0 / np.sqrt(precision)))
    assert np.abs(np.mean(z, axis=0)).max() < 4.0 / np.sqrt(400)
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.15)


def test_draws_that_were_widened_are_no_further_from_the_prior(distances):
    """As wide as the prior they left a fifth of it to compare with: 1.8 standard deviations were told as 8."""
    narrow, wide = (distances(np.array([-0.6, np.log(2.0)]), np.array([0.15, 0.1]), by) for by in (1.0, 3.3))
    np.testing.assert_allclose(wide, narrow, atol=0.05)
    assert narrow[0] == pytest.approx(-0.9 / np.sqrt(0.5**2 - 0.15**2), abs=0.05)


def test_few_draws_of_what_a_record_hardly_tells_are_not_far_from_the_prior(distances):
    """The variances differ by a seventh, which 200 draws know to a tenth: three deviations were told six times too often."""
    z = []
    for _ in range(2000):
        told, spread = np.sqrt(0.15) * RNG.standard_normal(2), np.array([0.5, 0.2])
        z.append(distances(np.array([0.3, np.log(2.0)]) + told * spread, np.sqrt(0.85) * spread, draws=100))
    assert np.mean(np.abs(z) > 3.0) < 0.0027


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_disturbance_is_named_by_the_axis_or_canopy_it_acts_on(n):
    """Each alone, a unit from the first sample on, against what the air has that the equations of motion take."""
    given = SimpleNamespace(wind=np.zeros(3), axial_factor=np.ones(n), density=1.0)
    for row in range(4 + 3 * n):
        error = np.zeros(4 + 3 * n)
        error[row] = 1.0
        air = air_between(given, given, error, error, 0.0, 0.1)
        north, east = air.push
        moved = dict(zip(("north", "east", "down"), air.wind.stack(), strict=True)) | {"": air.roll}
        for i in range(n):
            moved |= {
                f"of canopy {i + 1}": air.axial_factor[i] - 1.0,
                f"north of canopy {i + 1}": north[i],
                f"east of canopy {i + 1}": east[i],
            }
        assert [name for name, value in moved.items() if value != 0.0] == [record_misfit.place_of(row, n)]
