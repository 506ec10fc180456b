"""Statistics of flights, against values counted by hand."""

from __future__ import annotations

import numpy as np

from bayeschute.prediction.bands import Prediction
from bayeschute.prediction.flight_statistics import MEANINGS, STATISTICS, UNITS, flight_statistics


def test_statistics_are_of_the_window_and_the_end_is_the_last_sample():
    rate = np.array([[9.0, 1.0, 4.0, 2.0], [9.0, 5.0, 6.0, 7.0], [np.nan] * 4])
    last = np.array([[3.0, 4.0, 2.0], [0.0, 1.0, 7.0], [np.nan] * 3])
    made = flight_statistics(
        Prediction(np.arange(4.0), {"descent_rate": rate}, last, 1, {}), np.array([False, True, True, True])
    )
    assert set(made) == set(STATISTICS)
    np.testing.assert_allclose(made["final"]["descent_rate"], [2.0, 7.0, np.nan])
    np.testing.assert_allclose(made["final"]["horizontal_speed"], [5.0, 1.0, np.nan])
    np.testing.assert_allclose(made["maximum"]["descent_rate"], [4.0, 7.0, np.nan])
    np.testing.assert_allclose(made["mean"]["descent_rate"], [7.0 / 3.0, 6.0, np.nan])
    assert "horizontal_speed" not in made["maximum"], "its history is not kept"


def test_every_quantity_has_a_unit_and_a_meaning():
    assert set(UNITS) == set(MEANINGS)
