"""Draws of flights made in parts: the same bit for bit, in whatever order and process; what is lost is counted."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from bayeschute.calibration.workers import Lost
from bayeschute.core.errors import InputError
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.marginal import Marginal
from bayeschute.prediction.bands import GROUP
from bayeschute.study.job import Job
from bayeschute.study.load import load_study
from bayeschute.study.run import forecasts as module
from bayeschute.study.run.forecasts import forecast_flights, stored_forecast


@pytest.fixture(scope="module")
def job(finished, descents):
    return Job(load_study(descents.study), finished.folder, False, "", lambda *_: None)


@pytest.fixture(scope="module")
def alone(job):
    """Drawn by this process."""
    return list(forecast_flights(job))


@pytest.fixture
def small_parts(monkeypatch):
    monkeypatch.setattr(module, "PART", 2 * GROUP)


def same(a, b) -> bool:
    """Whether predictions are the same, NaN included."""
    assert set(a.draws) == set(b.draws) and a.failed == b.failed and a.shares == b.shares
    assert all(a.draws[name].tobytes() == b.draws[name].tobytes() for name in a.draws)
    return a.last.tobytes() == b.last.tobytes() and a.time.tobytes() == b.time.tobytes()


def test_parts_in_any_order_are_the_whole(job, alone, small_parts):
    flights = [f for f in job.study.flights if f.roles]
    (order,), _ = module._orders(job, flights[1])
    assert [part.stop for part in order.parts()] == [2, 4, 6, 7]
    carried = pickle.loads(pickle.dumps(order))  # as a worker gets it
    made = {part.start: carried.draw(part) for part in reversed(order.parts())}
    assert same(module._joined(order, made), alone[1].prediction)


def test_fitted_flights_are_drawn_from_their_fit(job):
    for flight in job.study.flights:
        (order,), _ = module._orders(job, flight)
        assert isinstance(order.known, Marginal) and order.whole is None


def test_over_processes_the_same_bit_for_bit(job, alone, small_parts):
    pytest.importorskip("distributed", reason="Dask is not installed")
    said = []
    spread = replace(job, workers=2, progress=lambda stage, share, words: said.append((share, words)))
    for one, want in zip(forecast_flights(spread), alone, strict=True):
        assert one.flight == want.flight and same(one.prediction, want.prediction)
        np.testing.assert_array_equal(one.counted, want.counted)
    assert said[-1] == (1.0, "8 of 8 parts")


def test_parts_that_were_lost_count_as_failed(job, alone, small_parts):
    (order,), _ = module._orders(job, job.study.flights[0])
    made = {part.start: order.draw(part) for part in order.parts()}
    assert len(order.theta) == 100
    lost = module._joined(order, made | {2: Lost("killed"), 6: Lost("killed")})
    whole = alone[0].prediction
    assert lost.failed == whole.failed + 2 * GROUP + 4
    for name, values in lost.draws.items():
        gone = np.isnan(values).all(axis=1)
        assert gone[2 * GROUP : 4 * GROUP].all() and gone[6 * GROUP :].all()
        np.testing.assert_array_equal(values[~gone], whole.draws[name][~gone])
    with pytest.raises(InputError, match="worker lost: killed"):
        module._joined(order, made | {0: Lost("killed")})


def test_a_flight_whose_opening_can_not_be_fitted_has_failed_simulations_and_says_why(
    job, alone, small_parts, monkeypatch
):
    """Of the whole flight and of its parts alike; nothing else is lost."""

    def opened(*given):
        raise FloatingPointError("steps fail")

    (order,), tell = module._orders(job, job.study.flights[1])
    whole, priors = order.known.flights[0], [Prior("cds_over_mass", 0.0, 1.0, True, "m^2/kg", "")]
    unseen = replace(order, known=(order.known.hyper, priors), whole=whole)
    monkeypatch.setattr(module.bands, "opened", opened)
    made = unseen.draw()
    assert made.failed == len(order.theta) and made.why == "its first 5 s: steps fail"
    assert {name: values.shape for name, values in made.draws.items()} == {
        name: values.shape for name, values in alone[1].prediction.draws.items()
    }
    assert np.isnan(made.last).all() and np.isnan(np.concatenate([*made.draws.values()])).all()
    assert {name: list(one) for name, one in made.shares.items()} == {
        name: list(one) for name, one in alone[1].prediction.shares.items()
    }
    parts = {part.start: unseen.draw(part) for part in unseen.parts()}
    joined = module._joined(unseen, parts)
    assert joined.failed == made.failed and joined.why == made.why
    assert tell([made]).prediction.why == made.why


def test_many_draws_are_few_parts(job):
    (order,), _ = module._orders(job, job.study.flights[0])
    many = replace(order, theta=np.repeat(order.theta, 2000, axis=0)).parts()
    assert len(many) <= module._MOST_PARTS
    assert [i for part in many for i in part] == list(range(200_000 // GROUP))


def test_what_a_run_has_drawn_is_read_back(job, alone):
    for want in alone:
        one = stored_forecast(job, want.flight)
        assert one.flight == want.flight and one.seed == want.seed and one.prediction.failed == want.prediction.failed
        assert one.prediction.shares == want.prediction.shares and set(one.prediction.draws) == set(
            want.prediction.draws
        )
        for name, drawn in want.prediction.draws.items():
            np.testing.assert_allclose(one.prediction.draws[name], drawn, rtol=1e-6)
        np.testing.assert_array_equal(one.counted, want.counted)
        assert one.hyper.noise.white.tolist() == np.asarray(want.hyper.noise.white).tolist()


def test_draws_that_a_run_has_not_or_not_all_are_none(job, alone, tmp_path, monkeypatch):
    flight = alone[0].flight
    assert stored_forecast(replace(job, out=tmp_path), flight) is None
    assert stored_forecast(job, replace(flight, name="another")) is None
    read = module.load_groups

    def thinned(*asked):
        (kept,) = read(*asked)
        kept["descent_rate_draws"].attrs["thin"] = 2
        return (kept,)

    monkeypatch.setattr(module, "load_groups", thinned)
    assert stored_forecast(job, flight) is None
