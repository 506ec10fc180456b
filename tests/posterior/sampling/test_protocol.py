"""What samplers share: densities that are not finite are failures, whatever kind of not finite."""

from __future__ import annotations

import numpy as np

from bayeschute.posterior.sampling.protocol import Counted, Draws


def test_whatever_is_not_finite_is_no_place_to_be_and_counted():
    counted = Counted(lambda x: np.array([1, np.nan, np.inf, -np.inf, -1e300])[: x.shape[1]])
    np.testing.assert_array_equal(counted(np.zeros((2, 5))), [1.0, -np.inf, -np.inf, -np.inf, -1e300])
    counted(np.zeros((2, 1)))
    assert (counted.failed, counted.evaluations) == (3, 6)


def test_draws_share_no_statistics():
    one, other = (Draws(np.zeros((1, 1, 1)), np.zeros((1, 1))) for _ in range(2))
    assert one.stats is not other.stats and one.notes == ()
