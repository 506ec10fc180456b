"""Starting values by longer and longer first parts of a record: shortened where flights fail, and begun anew."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.posterior import joint_mode
from bayeschute.posterior.fit import continuation


@pytest.mark.parametrize(
    ("least", "shares"),
    [
        (0.0, [0.2, 0.5, 1.0]),
        (0.15, [0.2, 0.1, 0.2, 0.5, 1.0]),  # the flight that begins fails before 20 % of the record
        (0.06, [0.2, 0.1, 0.05, 0.1, 0.2, 0.5, 1.0]),
    ],
)
def test_openings_are_shortened_where_the_first_flight_fails(descent, monkeypatch, least, shares):
    """What flies from the beginning ends within a share `least` of the record; once fitted it goes twice as far."""
    tried, reach = [], [least or 1.0]

    def fit(flights, hyper, priors, theta, unknowns, **options):
        seen = np.asarray(flights[0].present).any(axis=1)
        share = (np.flatnonzero(seen)[-1] + 1) / seen.size
        tried.append(share)
        assert options["first_part"] == (share < 1.0)
        if share > reach[0]:
            raise FloatingPointError("lost")
        reach[0] = 2.5 * share if share < 0.15 else 1.0
        return SimpleNamespace(theta=theta, unknowns=[f.still() for f in flights])

    monkeypatch.setattr(joint_mode, "fit", fit)
    continuation.lengthened(descent.flights, descent.priors, descent.hyper, descent.theta, lambda *_: None)
    assert tried == pytest.approx(shares, abs=0.03)


def test_an_opening_of_a_twentieth_that_fails_ends_the_search(descent, monkeypatch):
    tried = []

    def fit(flights, *_, **options):
        tried.append(1)
        raise FloatingPointError("lost")

    monkeypatch.setattr(joint_mode, "fit", fit)
    with pytest.raises(FloatingPointError, match="lost"):
        continuation.lengthened(descent.flights, descent.priors, descent.hyper, descent.theta, lambda *_: None)
    assert len(tried) == 4


def test_an_opening_that_led_astray_is_begun_anew_in_small_steps(descent, monkeypatch):
    """Steps of more than a sixth of the record lead to where no longer opening flies; small ones begin where all did."""
    tried, astray = [], [False]

    def fit(flights, hyper, priors, theta, unknowns, **options):
        seen = np.asarray(flights[0].present).any(axis=1)
        share = (np.flatnonzero(seen)[-1] + 1) / seen.size
        before = tried[-1] if tried and unknowns is not None else 0.0
        if unknowns is None:
            np.testing.assert_array_equal(theta, descent.theta)
            astray[0] = False
        if astray[0]:
            raise FloatingPointError("lost")
        astray[0] = share - before > 1.0 / 6.0
        tried.append(share)
        return SimpleNamespace(theta=theta + 1.0, unknowns=[f.still() for f in flights])

    monkeypatch.setattr(joint_mode, "fit", fit)
    found, _ = continuation.lengthened(descent.flights, descent.priors, descent.hyper, descent.theta, lambda *_: None)
    assert tried == pytest.approx([0.2, *np.linspace(0.1, 1.0, 10)], abs=0.03)
    np.testing.assert_allclose(found, descent.theta + 10.0)
