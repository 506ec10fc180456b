from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.structure.data_adequacy import (
    noise_sentences,
    record_sentences,
    rival_sentences,
    swing_period,
    variable_sentences,
)


def risers(time, period):
    """Two risers that swing as a pendulum, and wander a little (T, 2, 3)."""
    rng = np.random.default_rng(2)
    angle = 0.3 * np.sin(2.0 * np.pi * time / period)[:, None] + np.array([-0.1, 0.1])
    sideways = np.stack([0.8 * np.sin(angle), 0.6 * np.sin(angle)], axis=-1) + 0.02 * rng.normal(size=(len(time), 2, 2))
    return np.concatenate([sideways, -np.cos(angle)[..., None]], axis=-1)


def made(speed_spread=0.02, n=900, distance=0.65):
    rng = np.random.default_rng(0)
    data = {
        "alpha_T": rng.uniform(0.2, 0.5, size=(n, 2)),
        "airspeed": 10 * (1 + speed_spread * rng.normal(size=(n, 2))),
        "D_prox": distance + 0.05 * rng.uniform(-1, 1, size=(n, 2)),
    }
    time = 0.1 * np.arange(n)
    found = {k: (("time", "canopy"), v) for k, v in data.items()}
    return xr.Dataset(found | {"riser_direction": (("time", "canopy", "axis"), risers(time, 15.0))}, {"time": time})


def test_range_length_and_airspeed_are_told():
    said = " ".join(record_sentences("drop", made()))
    assert "between 12 and 28 deg" in said and "90 s, about 6 periods of the swing of 15 s each" in said
    assert "airspeed varies by 2 % only" in said and "rarely below 12 deg" in said
    assert "between 0.60 and 0.70 reference lengths" in said
    assert "only" not in " ".join(record_sentences("drop", made(0.2))[3:])


@pytest.mark.parametrize("period", [3.4, 14.5])
def test_the_period_of_the_swing_is_that_of_the_record_gaps_or_not(period):
    time = 0.1 * np.arange(1500)
    directions = risers(time, period)
    directions[400:430] = np.nan
    assert swing_period(time, directions) == pytest.approx(period, rel=0.06)


def test_a_single_canopy_has_no_distance():
    assert not any("reference lengths" in s for s in record_sentences("drop", made(distance=np.nan)))


def test_variables_that_move_together():
    rng = np.random.default_rng(1)
    v = rng.normal(size=300)
    values = {"speed": v, "q": 60 * (1 + v / 10) ** 2, "alpha": rng.normal(size=300), "distance": np.full(300, np.nan)}
    values["alpha"][5] = np.nan
    (said,) = variable_sentences("drop, canopy 1", values)
    assert "airspeed and dynamic pressure are highly correlated (0.99)" in said or "(1.00)" in said
    (none,) = variable_sentences("drop", {"speed": v, "alpha": rng.normal(size=300)})
    assert "no two explanatory variables" in none
    assert variable_sentences("drop", {"odd": v}) == []


def test_noise_and_rivals():
    enough, little = noise_sentences({"C_A": 51.0, "C_N": 2.0})
    assert "51, enough" in enough and "not reliable" in little
    rivals = [
        {"term": "alpha", "rival": "alpha*q", "correlation": 0.98, "chance": 0.2},
        {"term": "q", "rival": "q^2", "correlation": 0.99, "chance": 0.0},
    ]
    (said,) = rival_sentences("C_N", rivals)
    assert "alpha may be confused with alpha*q" in said and "by noise 20 %" in said
