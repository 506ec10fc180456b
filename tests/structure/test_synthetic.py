from __future__ import annotations

import json

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.structure.candidates import product_pool
from bayeschute.structure.search import Search
from bayeschute.structure.synthetic import Making, replicate, true_columns
from bayeschute.structure.synthetic_entry import checks, penalty_per_term, synthetic_entry

DT = 0.1
TRUTH = {"1": 0.9, "alpha*q": 0.4}
MAKING = Making(12.0, 0.5, 25)


def pool(n=900, gap=True):
    """Variables that move apart; the last resembles the first."""
    rng = np.random.default_rng(0)
    t = DT * np.arange(n)
    alpha = np.sin(0.44 * t) + 0.3 * np.sin(1.1 * t)
    q = np.cos(0.3 * t) + 0.3 * np.cos(0.9 * t)
    values = {"alpha": alpha, "q": q, "closing": np.sin(0.7 * t), "speed": 0.97 * q + 0.25 * np.sin(2.1 * t)}
    if gap:
        values["closing"] = np.where(rng.random(n) < 0.02, np.nan, values["closing"])
    return product_pool(values, 2)


@pytest.fixture(scope="module")
def found():
    how = Search(sigma_max=5.0, exchange=True, first=("1",))
    return replicate(pool(), {"1": 0.9, "q*alpha": 0.4}, MAKING, DT, how, np.random.default_rng(1))


def test_data_are_as_asked_for(found):
    X = pool().matrix()[:, list(found.true)]
    signal = (X @ found.value)[np.isfinite(pool().matrix()).all(axis=1)]
    assert found.sigma == pytest.approx(np.sqrt(np.mean(signal**2)) / 12.0)
    phi = np.exp(-DT / 0.5)
    assert found.memory == pytest.approx((1 + phi) / (1 - phi))
    residual = found.first_fit.residual[found.first_fit.used]
    assert np.std(residual) == pytest.approx(found.sigma, rel=0.25)
    assert found.first_fit.autocorrelation_time == pytest.approx(found.memory, rel=0.5)
    assert [found.names[j] for j in found.true] == ["1", "alpha*q"]


def test_true_terms_are_selected_and_intervals_cover(found):
    shares = found.kept.mean(axis=0)
    assert shares[list(found.true)].min() >= 0.9
    assert np.delete(shares, list(found.true)).max() <= 0.2
    # 50 intervals at 90 %: 45 expected, standard deviation 2.1 if independent
    assert 37 <= found.inside.sum() <= 50 and found.white_inside.mean() < 0.75
    assert np.abs(found.z).mean() == pytest.approx(0.8, abs=0.25)
    assert (found.white_se < found.se / 2).all()
    assert not (found.kept_inside & ~found.kept[:, list(found.true)]).any()


def test_the_rival_is_the_neighbour(found):
    rival = dict((r.term, r) for r in found.rivals)["alpha*q"]
    assert rival.rival == "alpha*speed" and 0.5 < rival.correlation < 1.0


def test_the_same_seed_gives_the_same_and_progress_is_told(found):
    how, said = Search(sigma_max=5.0, exchange=True, first=("1",)), list[float]()
    again = replicate(pool(), TRUTH, Making(12.0, 0.5, 3), DT, how, np.random.default_rng(1), progress=said.append)
    np.testing.assert_array_equal(again.estimate, found.estimate[:3])
    assert said == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_noise_drowns_what_is_weak():
    how = Search(sigma_max=5.0)
    drowned = replicate(pool(), TRUTH, Making(0.5, 0.5, 6), DT, how, np.random.default_rng(2))
    assert drowned.kept[:, drowned.true[1]].mean() < 0.7 and drowned.exact < 0.7


def test_white_noise_needs_no_correction():
    white = replicate(pool(), TRUTH, Making(12.0, 0.0, 6), DT, Search(sigma_max=5.0), np.random.default_rng(3))
    assert white.memory == 1.0
    np.testing.assert_allclose(np.median(white.se / white.white_se, axis=0), 1.0, atol=0.25)


def test_the_entry(found):
    told = synthetic_entry(found, MAKING, pool().matrix())
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert [t["term"] for t in told["true"]] == ["1", "alpha*q"] and told["true"][1]["unit"] == "1/(rad Pa)"
    assert told["least_true"] == found.kept.mean(axis=0)[list(found.true)].min()
    assert told["coverage"] == pytest.approx(found.inside.mean())
    assert all(f["term"] not in ("1", "alpha*q") for f in told["false"])
    low, high = told["penalty_per_term"]
    assert low == pytest.approx(2 * told["ceiling"]["value"] / told["samples"]) == high
    judged = checks({"C_A": told})
    assert judged["penalty per term constant"]["passed"] and judged["true terms selected"]["passed"]
    assert judged["true terms selected"]["value"] == told["least_true"]
    worse = checks({"C_A": told, "C_N": told | {"least_true": 0.5, "most_false": 0.4}})
    assert not worse["true terms selected"]["passed"] and not worse["false terms selected"]["passed"]
    assert penalty_per_term([{"pe": 2.0, "mse": 1.0, "n": 1}, {"pe": 3.0, "mse": 1.0, "n": 2}]) == [3.0, 4.0]


def test_bad_input_is_refused():
    how, rng = Search(), np.random.default_rng(0)
    with pytest.raises(InputError, match=r"distance.*Widen"):
        true_columns(pool(), {"alpha*distance": 1.0}, "synthetic C_A")
    for truth, making in (
        (TRUTH, Making(12.0, 0.5, 1)),
        (TRUTH, Making(0.0, 0.5, 3)),
        ({"1": 0.0}, Making(12.0, 0.5, 3)),
    ):
        with pytest.raises(InputError):
            replicate(pool(), truth, making, DT, how, rng)
