"""Sentences of the report that are made from numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from bayeschute.report.sentences import extrapolation_sentences, key_sentences, structure_sentences


def _of(pair):
    return structure_sentences(
        {"selected": [{}, {}], "collinearity": {"max_correlation": 0.4, "pair": pair, "max_vif": 1.2}}
    )


def test_a_correlation_is_given_only_of_two_terms_besides_the_constant():
    words = "Largest correlation between two selected terms: 0.40 (e and rate)"
    assert any(words in line for line in _of(["e", "rate"]))
    assert not any("correlation" in line for line in _of(["", ""]))


def _predicted(role, most):
    """Draws of a swing between nothing and some angle [rad], evenly."""
    draws = np.linspace(0.0, most, 2000).reshape(20, 100)
    draws[3, 40:] = np.nan  # a draw whose simulation failed on the way
    return xr.Dataset({"swing_angle_draws": (("draw", "time"), draws)}, attrs={"role": role})


@pytest.mark.parametrize(("most", "told"), [(0.2, None), (0.205, None), (0.4, "52 %")])
def test_a_flight_that_swings_further_than_was_fitted_is_told(results, most, told):
    flights = {"known": _predicted("identify", 0.2), "coming": _predicted("predict", most)}
    found = extrapolation_sentences(replace(results, predictions=flights))
    if told is None:
        assert found == []
        return
    (words,) = found
    assert words.startswith("coming swings further than 11.4 deg, the most that was fitted, in 52 % of its predicted")
    assert key_sentences(replace(results, predictions=flights))[-1] == words
    alone = {"coming": flights["coming"]}
    assert extrapolation_sentences(replace(results, predictions=alone)) == []
