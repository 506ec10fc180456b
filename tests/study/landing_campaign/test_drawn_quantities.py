"""Quantities that may be drawn: a mean alone, a mean and a standard deviation, and what is neither."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from bayeschute.core.errors import InputError
from bayeschute.study.landing_campaign.campaign_file import load_campaign
from bayeschute.study.landing_campaign.drawn_quantities import Altitudes, Angles, Rates, Shares, Speeds

LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'
DEG = np.pi / 180.0


@pytest.mark.parametrize(
    ("kind", "said", "want"),
    [
        (Altitudes, "1000 ft", (304.8, 0.0)),
        (Altitudes, {"mean": "-1000 m", "sd": "80 km"}, (-1000.0, 80_000.0)),
        (Angles, {"mean": "-5 deg"}, (-5.0 * DEG, 0.0)),
        (Angles, {"mean": "-360 deg", "sd": "360 deg"}, (-2.0 * np.pi, 2.0 * np.pi)),
        (Rates, {"mean": "1 deg/s", "sd": "2 deg/s"}, (DEG, 2.0 * DEG)),
        (Rates, "-20 rad/s", (-20.0, 0.0)),
        (Speeds, {"mean": "36 km/h", "sd": "1 m/s"}, (10.0, 1.0)),
        (Shares, 1.5, (1.5, 0.0)),
        (Shares, 0, (0.0, 0.0)),
        (Shares, {"mean": 1, "sd": 0.25}, (1.0, 0.25)),
        (Shares, {"mean": 1e6}, (1e6, 0.0)),
    ],
)
def test_mean_and_standard_deviation_are_in_si(kind, said, want):
    made = TypeAdapter(kind).validate_python(said)
    assert made == pytest.approx(want, rel=1e-12) and all(type(value) is float for value in made)


@pytest.mark.parametrize(
    ("kind", "said", "words"),
    [
        (Altitudes, "-1001 m", ">= -1000 m"),
        (Altitudes, "80.1 km", "<= 80000 m"),
        (Altitudes, {"mean": "0 m", "sd": "-1 m"}, ">= 0 m"),
        (Altitudes, {"mean": "0 m", "sd": "81 km"}, "<= 80000 m"),
        (Angles, "-361 deg", ">= -6.28319 rad"),
        (Rates, {"mean": "0 rad/s", "sd": "21 rad/s"}, "<= 20 rad/s"),
        (Speeds, "501 m/s", "<= 500 m/s"),
        (Angles, {"sd": "1 deg"}, "a table of sd"),
        (Angles, {}, "a table of nothing"),
        (Angles, {"mean": "1 deg", "sdd": "1 deg"}, "a table of mean, sdd"),
        (Angles, 5, "bare number"),
        (Shares, -0.1, "a number >= 0"),
        (Shares, 1.1e6, "a number >= 0"),
        (Shares, True, "a number >= 0"),
        (Shares, "1", "a number >= 0"),
        (Shares, {"sd": 0.1}, "a number >= 0"),
        (Shares, {"mean": 1.0, "sd": -0.1}, "a number >= 0"),
        (Shares, {"mean": 1.0, "sd": True}, "a number >= 0"),
        (Shares, {"mean": 1.0, "spread": 0.1}, "a table of mean, spread"),
    ],
)
def test_what_is_no_such_quantity_is_refused(kind, said, words):
    with pytest.raises(ValidationError) as refused:
        TypeAdapter(kind).validate_python(said)
    (error,) = refused.value.errors()
    assert words in f"{error['msg']} {error.get('ctx')}"


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("speed = { mean = 1.0, sdd = 0.2 }", "a table of mean, sdd"),
        ('swing = "1e300 deg"', "<= 6.28319 rad"),
        ('swing = { mean = "1 deg", sd = "1e300 deg" }', "<= 6.28319 rad"),
        ('horizontal = "1e9 m/s"', "<= 500 m/s"),
        ('swing_rate = "1e9 deg/s"', "<= 20 rad/s"),
    ],
)
def test_starts_that_cannot_be(tmp_path, line, word):
    (tmp_path / "c.toml").write_text(LEAST + line + "\n")
    with pytest.raises(InputError, match=re.escape(word)):
        load_campaign(tmp_path / "c.toml")
