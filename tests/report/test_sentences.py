"""Sentences of the report that are made from numbers."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from bayeschute.report import sentences
from bayeschute.report.sentences import prediction_sentence, structure_sentences


def _of(pair):
    return structure_sentences(
        {"selected": [{}, {}], "collinearity": {"max_correlation": 0.4, "pair": pair, "max_vif": 1.2}}
    )


def test_a_correlation_is_given_only_of_two_terms_besides_the_constant():
    words = "Largest correlation between two selected terms: 0.40 (e and rate)"
    assert any(words in line for line in _of(["e", "rate"]))
    assert not any("correlation" in line for line in _of(["", ""]))


def test_true_and_recorded_flights_are_both_named():
    coverage = {"virtual": {"descent_rate": {"truth": 0.9}}, "flown": {"descent_rate": {"record": 0.8}}}
    results = SimpleNamespace(part=lambda name: coverage if name == "coverage" else {})
    assert "80 % to 90 % of the true or recorded descent rate" in prediction_sentence(results)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"how": "search", "threshold": 2.0}, "its Bayes factor is at least 2"),
        ({"how": "selected"}, "those that equation error selects below"),
        ({"how": "pool"}, "all candidates"),
        ({"how": "search"}, "all candidates"),
    ],
)
def test_why_a_flight_has_its_terms(found, words):
    assert words in sentences.fitted_terms(found)
