from __future__ import annotations

import numpy as np
import xarray as xr

from bayeschute.structure.data_adequacy import noise_sentences, record_sentences, rival_sentences, variable_sentences


def made(speed_spread=0.02, n=900, distance=0.65):
    rng = np.random.default_rng(0)
    data = {
        "alpha_T": rng.uniform(0.2, 0.5, size=(n, 2)),
        "airspeed": 10 * (1 + speed_spread * rng.normal(size=(n, 2))),
        "D_prox": distance + 0.05 * rng.uniform(-1, 1, size=(n, 2)),
    }
    return xr.Dataset({k: (("time", "canopy"), v) for k, v in data.items()}, {"time": 0.1 * np.arange(n)})


def test_range_length_and_airspeed_are_told():
    said = " ".join(record_sentences("drop", made()))
    assert "between 12 and 28 deg" in said and "90 s, about 6 pendulum periods" in said
    assert "airspeed varies by 2 % only" in said and "rarely below 12 deg" in said
    assert "between 0.60 and 0.70 reference lengths" in said
    assert "only" not in " ".join(record_sentences("drop", made(0.2))[3:])


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
