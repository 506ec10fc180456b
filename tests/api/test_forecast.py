"""`Forecast` of draws that are known: statistics, bands, probabilities, checks, parts of the time; who may fly."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from scipy import stats

import bayeschute as bc
from bayeschute.api import forecast as module
from bayeschute.api.forecast import Forecast, Probability, forecast, forecast_of
from bayeschute.calibration.label import CONTRADICTED
from bayeschute.prediction import bands

TIME = np.arange(100.0, 110.0)


@pytest.fixture
def slowing() -> Forecast:
    """Descent rates that fall by 1 m/s each second, 101 draws 0.1 m/s apart; the first three samples were fitted."""
    rate = 20.0 - np.arange(10.0) + 0.1 * np.arange(101.0)[:, None]
    draws = xr.Dataset({"descent_rate": (("draw", "time"), rate, {"units": "m/s"})}, {"time": TIME})
    draws.attrs = {"failed": 0, "flight": "a"}
    truth = xr.Dataset({"descent_rate": ("time", rate[50])}, {"time": TIME})
    held_out = np.arange(10) >= 3
    return Forecast("a", draws, held_out, {"descent_rate": rate[-1] + 5.0}, truth, {}, 101, {}, 0)


@pytest.mark.parametrize(
    ("start", "end", "first", "last"),
    [(None, None, 100, 109), ("105 s", None, 105, 109), (None, 106.0, 100, 106), ("0.1 ks", "1.75 min", 100, 105)],
)
def test_ends_are_on_the_clock_of_the_record_and_included(slowing, start, end, first, last):
    part = slowing.between(start, end)
    assert part.draws["time"].values[[0, -1]].tolist() == [first, last]
    assert part.held_out.size == part.record["descent_rate"].size == part.truth.sizes["time"] == last - first + 1
    assert part.draws.attrs == slowing.draws.attrs and part.name == "a"


def test_statistics_and_probabilities_are_of_the_part(slowing):
    part = slowing.between("107 s")
    seen = 20.0 - np.array([7.0, 8.0, 9.0]) + 5.0
    assert float(part.statistic("descent_rate").median()) == pytest.approx(seen.mean())
    assert float(part.statistic("descent_rate", "maximum").median()) == pytest.approx(seen.max())
    assert part.probability("descent_rate", at_most=17.04).met == pytest.approx(51 / 101)
    assert slowing.probability("descent_rate", at_most=17.04).met < 0.5
    assert part.band("descent_rate")["median"].values == pytest.approx(seen)


def test_only_samples_that_were_not_seen_count_in_the_part_too(slowing):
    assert slowing.between(end="104 s").counted.tolist() == [False] * 3 + [True] * 2
    rows = slowing.between("104 s", "106 s").check(levels=(0.9,)).set_index("reference")
    assert rows["samples"].tolist() == [3, 3] and rows.loc["truth", "inside 90 %"] == 1.0
    assert rows.loc["record", "inside 90 %"] == 0.0


@pytest.mark.parametrize(("start", "end"), [("200 s", None), ("104.2 s", "104.8 s"), ("106 s", "103 s"), (109.0, None)])
def test_a_part_without_samples_is_refused_with_what_there_is(slowing, start, end):
    with pytest.raises(bc.InputError, match="100 to 109 s"):
        slowing.between(start, end)


def test_a_length_is_no_time(slowing):
    with pytest.raises(bc.InputError, match="start"):
        slowing.between("3 m")


@pytest.fixture
def swinging() -> Forecast:
    draws = np.deg2rad(np.linspace(4.0, 6.0, 101))[:, None] * np.ones(5)
    values = {
        "swing_angle": (("draw", "time"), draws, {"units": "rad"}),
        "descent_rate": (("draw", "time"), 10.0 + draws, {"units": "m/s"}),
    }
    data = xr.Dataset(values, {"time": np.arange(5.0)}, {"failed": 0, "flight": "a"})
    return Forecast("a", data, np.zeros(5, bool), {}, None, {}, 101, {}, 0)


def test_the_table_has_the_units_of_the_figure(swinging):
    told = swinging.summary("maximum")
    assert told["unit"].to_dict() == {"swing_angle": "deg", "descent_rate": "m/s"}
    assert told.loc["swing_angle", "median"] == pytest.approx(5.0)
    assert "<td>deg</td>" in swinging._repr_html_() and "rad" not in swinging._repr_html_()


def test_data_stay_in_si(swinging):
    band = swinging.band("swing_angle")
    assert band.attrs["units"] == "rad" and float(band["median"][0]) == pytest.approx(np.deg2rad(5.0))
    assert swinging.statistic("swing_angle").attrs["units"] == "rad"


def test_a_statistic_is_over_samples_that_were_not_seen(slowing):
    """Means over the last seven seconds, their maximum at the first of these, the end whatever was seen."""
    shift = 0.1 * np.arange(101.0)
    for name, wanted in (("mean", 14.0), ("maximum", 17.0), ("final", 11.0)):
        made = slowing.statistic("descent_rate", name)
        assert made.dims == ("draw",) and made.name == f"{name} descent_rate" and made.attrs["units"] == "m/s"
        np.testing.assert_allclose(made, wanted + shift)
    whole = replace(slowing, held_out=np.zeros(10, bool))
    assert whole.counted.all() and slowing.counted.tolist() == [False] * 3 + [True] * 7
    np.testing.assert_allclose(whole.statistic("descent_rate"), 15.5 + shift)
    with pytest.raises(bc.InputError, match="statistic: got 'mode'; wanted one of final, maximum, mean"):
        slowing.statistic("descent_rate", "mode")
    with pytest.raises(bc.InputError, match="quantity: got 'speed'; wanted one of descent_rate"):
        slowing.statistic("speed")


def test_a_summary_is_a_median_and_a_central_interval(slowing):
    row = slowing.summary("final", 0.5).loc["descent_rate"]
    assert row[["low", "median", "high"]].to_list() == pytest.approx([11.0 + 2.5, 11.0 + 5.0, 11.0 + 7.5])
    assert slowing.summary().loc["descent_rate", "low"] == pytest.approx(14.0 + 0.5)
    assert slowing.summary().index.name == "quantity"
    ratio = slowing.draws.assign(descent_rate=slowing.draws["descent_rate"].assign_attrs(units="1"))
    assert replace(slowing, draws=ratio).summary().loc["descent_rate", "unit"] == "1"


def test_a_band_is_central_at_every_time(slowing):
    band, narrow = slowing.band("descent_rate"), slowing.band("descent_rate", 0.5)
    rate = 20.0 - np.arange(10.0)
    for made, low, high in ((band, 0.5, 9.5), (narrow, 2.5, 7.5)):
        np.testing.assert_allclose(made["low"], rate + low)
        np.testing.assert_allclose(made["median"], rate + 5.0)
        np.testing.assert_allclose(made["high"], rate + high)
    assert band.attrs == {"quantity": "descent_rate", "level": 0.9, "units": "m/s"} and narrow.attrs["level"] == 0.5
    assert band["low"].attrs["units"] == "m/s" and band["time"].values.tolist() == TIME.tolist()
    for wrong in (0.0, 1.0, 90.0):
        with pytest.raises(bc.InputError, match="level"):
            slowing.band("descent_rate", wrong)
    with pytest.raises(bc.InputError, match="one of descent_rate"):
        slowing.band("speed")


def test_failed_simulations_are_left_out_of_bands_and_meet_nothing(slowing):
    values = slowing.draws["descent_rate"].values.copy()
    values[:20] = np.nan
    draws = slowing.draws.assign(descent_rate=(("draw", "time"), values, {"units": "m/s"})).assign_attrs(failed=20)
    broken = replace(slowing, draws=draws)
    assert float(broken.band("descent_rate")["median"][0]) == pytest.approx(20.0 + 6.0)
    met = broken.probability("descent_rate", at_most=100.0)
    assert (met.met, met.draws, met.failed) == (pytest.approx(81 / 101), 101, 20)
    assert repr(met).endswith(
        "101 draws, 20 of them failed to simulate and counted as not met"
    ) and "20 failed" in repr(broken)


@pytest.mark.parametrize("confidence", [0.9, 0.5])
def test_a_probability_is_a_share_with_the_limits_of_a_binomial_one(slowing, confidence):
    """Clopper and Pearson's, for as many draws as are independent."""
    few = replace(slowing, independent=50)
    met = few.probability("descent_rate", "final", at_most=13.04, confidence=confidence)
    share = 21 / 101
    tail = 0.5 - 0.5 * confidence
    low = stats.beta.ppf(tail, 50 * share, 50 - 50 * share + 1.0)
    high = stats.beta.ppf(1.0 - tail, 50 * share + 1.0, 50 - 50 * share)
    assert (met.met, met.low, met.high) == pytest.approx((share, low, high))
    assert (met.confidence, met.draws, met.failed, met.failed_checks) == (confidence, 101, 0, ())


def test_limits_to_both_sides_and_in_other_units(slowing):
    def met(**limit):
        return slowing.probability("descent_rate", "final", **limit).met

    assert met(at_least=13.04) == pytest.approx(80 / 101) and met(at_most="13.04 m/s") == pytest.approx(21 / 101)
    assert met(at_most=f"{13.04 / 0.3048!r} ft/s") == met(at_most=13.04) and met(at_least="46.944 km/h") == met(
        at_least=13.04
    )
    assert met(at_most=0.0) == 0.0 and met(at_least=0.0) == 1.0
    assert slowing.probability("descent_rate", at_most=14.04).met == pytest.approx(1 / 101)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({}, "probability of descent_rate: got no limit; wanted at_most or at_least, exactly one"),
        ({"at_most": 1.0, "at_least": 0.5}, "got at_most=1.0 and at_least=0.5; wanted at_most or at_least"),
        ({"at_most": "3 kg"}, "at_most"), ({"at_least": "3 s"}, "at_least"),
    ],
)  # fmt: skip
def test_limits_that_make_no_sense_are_refused(slowing, limits, words):
    with pytest.raises(bc.InputError, match=words):
        slowing.probability("descent_rate", **limits)


def test_a_probability_on_one_line():
    told = repr(Probability(0.5, 0.4, 0.6, 0.95, 1200, 0, ("rhat", "mode")))
    assert told == (
        "P(met) = 0.500, 0.400 to 0.600 for the number of draws (95 %), 1,200 draws; "
        "no level of trust, failed checks: rhat, mode"
    )


def test_the_level_of_trust_is_told_with_every_answer(slowing):
    """Failed checks first: they leave none."""
    for level, words in (
        ("not checked", "level of trust: not checked"),
        ("self-consistent", "level of trust: self-consistent"),
        (CONTRADICTED, f"{CONTRADICTED}, no level of trust"),
    ):
        told = replace(slowing, level=level)
        for one in (told, told.probability("descent_rate", at_most=1.0)):
            assert repr(one).endswith(f"; {words}") and words in one._repr_html_()
        doubted = replace(told, failed_checks=("bands",))
        assert repr(doubted).endswith("; no level of trust, failed checks: bands") and words not in repr(doubted)


def test_failed_checks_are_told_with_every_answer(slowing):
    doubted = replace(slowing, failed_checks=("bands",))
    assert doubted.probability("descent_rate", at_most=1.0).failed_checks == ("bands",)
    assert repr(doubted) == repr(slowing) + "; no level of trust, failed checks: bands"
    assert repr(slowing) == "Forecast of a: 101 draws of descent_rate at 10 times, 0 failed"
    assert "mean over the flight" in slowing._repr_html_() and "14.5 to 23.5" in slowing._repr_html_()


def test_an_instrument_adds_its_noise(slowing):
    noisy = replace(slowing, recorded_with={"descent_rate": (0.3, 0.4, 2.0)}, seed=5)
    off = noisy.as_recorded("descent_rate") - noisy.draws["descent_rate"]
    assert off.dims == ("draw", "time") and float(off.var()) == pytest.approx(0.25, rel=0.2)
    assert noisy.as_recorded("descent_rate").equals(noisy.as_recorded("descent_rate"))
    assert not noisy.as_recorded("descent_rate").equals(replace(noisy, seed=6).as_recorded("descent_rate"))
    assert slowing.as_recorded("descent_rate").equals(slowing.draws["descent_rate"])
    with pytest.raises(bc.InputError, match="one of descent_rate"):
        slowing.as_recorded("speed")


def test_a_check_counts_samples_that_are_known_and_were_not_seen(slowing):
    """The truth lies at the upper half's ends or beyond, the record nowhere near; gaps do not count."""
    rate = 20.0 - np.arange(10.0)
    truth = rate + np.where(np.arange(10) < 6, 7.0, 9.0)
    truth[4] = np.nan
    made = replace(slowing, truth=xr.Dataset({"descent_rate": ("time", truth)}, {"time": TIME}))
    table = made.check((0.5, 0.9, 0.7)).set_index("reference")
    assert list(table.columns) == ["quantity", "samples", "inside 50 %", "inside 90 %", "inside 70 %", "p", "passed"]
    row = table.loc["truth"]
    assert row["samples"] == 6 and row["inside 90 %"] == 1.0
    assert row["inside 50 %"] == pytest.approx(2 / 6) and row["inside 70 %"] == pytest.approx(2 / 6)
    assert table.loc["record", "samples"] == 7 and table.loc["record", "inside 90 %"] == 0.0
    assert row["p"] == 1.0 and table.loc["record", "p"] == pytest.approx(11 / 102)  # ten of 101 draws are never inside
    assert table["passed"].to_list() == [True, True]
    edges = xr.Dataset({"descent_rate": ("time", rate + 0.5)}, {"time": TIME})
    assert replace(slowing, truth=edges, record={}).check((0.9001,))["inside 90.01 %"].to_list() == [1.0]


def test_a_record_that_was_fitted_is_compared_only_with_its_own_noise_known(slowing):
    """A record that lies in the band of what was recorded, though not in that of the draws."""
    off = np.where(np.arange(10) % 2, 12.0, -2.0)
    fitted = replace(slowing, held_out=np.zeros(10, bool), record={"descent_rate": 20.0 - np.arange(10.0) + off})
    assert fitted.check()["reference"].to_list() == ["truth"]
    known = replace(fitted, recorded_with={"descent_rate": (20.0, 1.0, 1.0)})
    rows = known.check((0.9,)).set_index("reference")
    assert rows.loc["record", "samples"] == 10 and rows.loc["record", "inside 90 %"] == 1.0
    held = replace(fitted, held_out=np.ones(10, bool)).check((0.9,)).set_index("reference")
    assert held.loc["record", "inside 90 %"] == 0.0


def test_without_record_and_truth_there_is_nothing_to_check_by(slowing):
    with pytest.raises(bc.InputError, match="forecast of a: got no record"):
        replace(slowing, record={}, truth=None).check()
    other = xr.Dataset({"speed": ("time", np.ones(10))}, {"time": TIME})
    with pytest.raises(bc.InputError, match="no record"):
        replace(slowing, record={}, truth=other).check()


def test_draws_that_all_failed_hold_nothing(slowing):
    draws = slowing.draws * np.nan
    draws["descent_rate"].attrs, draws.attrs = {"units": "m/s"}, {"failed": 101, "flight": "a"}
    rows = replace(slowing, draws=draws).check((0.9,))
    assert rows["inside 90 %"].isna().all() and rows["samples"].to_list() == [7, 7] and rows["p"].isna().all()


def test_a_probability_is_shown_with_its_limits_and_what_it_lacks():
    found = bc.Probability(0.8, 0.71, 0.87, 0.9, 64, 2, ("bands",))
    shown = found._repr_html_()
    assert "<td>0.800</td>" in shown and "0.710 to 0.870 (90 %)" in shown and "<td>64, 2</td>" in shown
    assert "bands" in shown and "bands" not in replace(found, failed_checks=())._repr_html_()


def test_p_of_a_flight_drawn_from_the_forecast_is_uniform(slowing):
    """Flights out of phase for long: shares inside scatter, p says how far. Too narrow bands have a small one."""
    rng, time = np.random.default_rng(4), np.linspace(0.0, 60.0, 10)

    def flights(count: int) -> np.ndarray:
        return 5.0 * np.sin(time + rng.normal(0.0, 0.5, (count, 1)) * time / 10.0) + rng.normal(0.0, 0.3, (count, 10))

    axes = {"draw": np.arange(400), "time": slowing.draws["time"]}
    draws = xr.Dataset({"descent_rate": (("draw", "time"), flights(400), {"units": "m/s"})}, axes, slowing.draws.attrs)
    wide = replace(slowing, draws=draws, record={}, held_out=np.ones(10, bool))

    def told(truth: np.ndarray) -> float:
        known = xr.Dataset({"descent_rate": ("time", truth)}, {"time": slowing.draws["time"]})
        return replace(wide, truth=known).check((0.5, 0.9))["p"].item()

    p = np.array([told(one) for one in flights(300)])
    for share in (0.1, 0.3):  # not less often than it says; with ties more often
        assert np.mean(p <= share) <= share + 3.0 * np.sqrt(share * (1.0 - share) / 300)
    assert p.min() < 0.1 and told(np.full(10, 12.0)) < 0.05


@pytest.fixture
def shared_out(slowing):
    """The same with what the variance is made of."""
    return replace(slowing, shares={"descent_rate": {"parameters": 0.25, "disturbances": 0.75}})


def test_a_dataset_has_quantiles_record_and_truth(shared_out):
    made = shared_out.to_dataset()
    np.testing.assert_allclose(made["descent_rate"].sel(quantile=0.5), 25.0 - np.arange(10.0))
    np.testing.assert_array_equal(made["descent_rate_record"], shared_out.record["descent_rate"])
    np.testing.assert_array_equal(made["descent_rate_truth"], shared_out.truth["descent_rate"])
    assert made["variance_share"].values.ravel().tolist() == [0.25, 0.75] and made["held_out"].sum() == 7
    assert made.attrs == {"role": "predict", "failed": 0} and made["time"].values.tolist() == TIME.tolist()
    fitted = replace(shared_out, held_out=np.zeros(10, bool), draws=shared_out.draws.assign_attrs(failed=3))
    assert fitted.to_dataset().attrs == {"role": "identify", "failed": 3}


def test_a_band_is_drawn_with_its_limit(shared_out):
    axes = shared_out.plot_band("descent_rate", limit=f"{9.0 / 0.3048!r} ft/s")
    assert axes.get_ylabel() == "[m/s]" and axes.get_xlabel() == "time [s]" and axes.figure.legends

    def limited(drawn):
        return any(np.allclose(line.get_ydata(), 9.0) for line in drawn.lines)

    assert limited(axes) and not limited(shared_out.plot_band("descent_rate"))
    mine = Figure().add_subplot()
    assert shared_out.plot_band("descent_rate", ax=mine) is mine and not mine.figure.legends and not mine.get_legend()
    with pytest.raises(bc.InputError, match="limit"):
        shared_out.plot_band("descent_rate", limit="3 kg")
    with pytest.raises(bc.InputError, match="one of descent_rate"):
        shared_out.plot_band("speed")
    assert any(limited(one) for one in shared_out.plot({"descent_rate": 9.0}).axes)


def foreseen(name="a", canopies=None, failed=0, draws=8):
    """What the stage `predict` makes, of draws of two quantities at five times."""
    values = {name: np.full((draws, 5), float(i)) for i, name in enumerate(("descent_rate", "flyout_angle"))}
    prediction = SimpleNamespace(draws=values, failed=failed, shares={"descent_rate": {"all": 1.0}})
    record = xr.Dataset() if canopies is None else xr.Dataset({"x": ("canopy", np.zeros(canopies))})
    return SimpleNamespace(
        flight=SimpleNamespace(name=name), prediction=prediction, record=record, time=np.arange(5.0), seed=3,
        held_out=np.arange(5) > 2, truth="truth", hyper="hyper",
    )  # fmt: skip


@pytest.fixture
def checked(monkeypatch):
    """A job whose draws are worth 5.7 independent ones, one of whose checks failed; one channel has noise."""
    checks = {
        "ess_bulk": {"a": 40.0, "b": 5.7},
        "checks": {"rhat": {"passed": False}, "mode": {"passed": True}, "ess": {"passed": False}},
    }
    monkeypatch.setattr(module, "recorded_quantities", lambda job, flight, record: {"descent_rate": flight.name})
    noise = lambda job, stored, name: (1.0, 2.0, 3.0) if name == "descent_rate" else None  # noqa: E731
    monkeypatch.setattr(module, "channel_noise", noise)
    monkeypatch.setattr(module, "when_lost", lambda job: "try this")
    return SimpleNamespace(load=lambda name: {"checks.json": checks}[name])


def test_a_forecast_of_a_run_has_what_its_stages_made(checked):
    made = Forecast.of(checked, foreseen())
    assert made.name == made.draws.attrs["flight"] == "a" and made.draws.attrs["failed"] == 0
    assert made.quantities == ("descent_rate", "flyout_angle") and made.draws["flyout_angle"].attrs["units"] == "rad"
    assert made.draws.sizes == {"draw": 8, "time": 5} and made.draws["time"].attrs == {"units": "s"}
    assert (made.independent, made.seed, made.truth) == (5, 3, "truth") and made.record == {"descent_rate": "a"}
    assert made.recorded_with == {"descent_rate": (1.0, 2.0, 3.0)} and made.failed_checks == ("rhat", "ess")
    assert made.shares == {"descent_rate": {"all": 1.0}} and made.held_out.tolist() == [False] * 3 + [True] * 2
    assert Forecast.of(checked, foreseen(draws=4)).independent == 4


def test_one_canopy_has_no_flyout_angle(checked):
    assert Forecast.of(checked, foreseen(canopies=1)).quantities == ("descent_rate",)
    assert "flyout_angle" in Forecast.of(checked, foreseen(canopies=2)).quantities


def test_bands_of_too_few_simulations_have_no_level(checked):
    """How many were lost, and what to do, is part of what it is called."""
    lost = Forecast.of(checked, foreseen(failed=7))
    assert lost.failed_checks == ("rhat", "ess", "bands") and lost.draws.attrs["failed"] == 7
    assert "7 of 8 simulations of a failed: its bands are of the others; try this; " in repr(lost)
    assert "simulations of a failed" not in repr(Forecast.of(checked, foreseen()))


def test_a_jobs_forecast_is_widened_as_its_calibration_says(monkeypatch):
    for name in ("forecast_flight", "widening", "widened"):
        monkeypatch.setattr(module, name, lambda *given, name=name: (name, *given))
    monkeypatch.setattr(Forecast, "of", classmethod(lambda cls, *given: given))
    assert forecast_of("job", "flight") == (
        "job",
        ("widened", ("forecast_flight", "job", "flight"), ("widening", "job")),
    )


@pytest.fixture
def asked(monkeypatch):
    """Studies and flights that are forecast, and those whose record is read first."""
    told = SimpleNamespace(forecast=[], read=[])
    monkeypatch.setattr(
        module, "forecast_of", lambda job, flight: told.forecast.append((job.study, flight)) or "forecast"
    )
    monkeypatch.setattr(module, "read_and_judge", lambda job, flight, raw: ("read", raw))
    monkeypatch.setattr(module, "ingest_flight", lambda job, flight, read: told.read.append((job.study, flight, read)))
    return told


def alone(sondes):
    """The study as of a posterior of the first sonde."""
    return replace(sondes.spec, flights=sondes.spec.flights[:1], requirements=())


def test_another_flight_joins_the_study_to_be_predicted(sondes, asked):
    spec, high = alone(sondes), sondes.flights["high"]
    assert forecast(spec, {}, high, 16, 0, None) == "forecast"
    ((study, flight),), ((of_record, read, raw),) = asked.forecast, asked.read
    assert flight == replace(high.spec, roles=("predict",)) == read and raw == ("read", None)
    assert study.flights == (spec.flights[0], flight) and study.seed == 0 and study.predict.draws == 16
    assert of_record == study == replace(spec, flights=study.flights, seed=0, predict=study.predict)
    forecast(spec, {}, high, None, None, None)
    assert asked.forecast[1][0].seed == 4 and asked.forecast[1][0].predict == spec.predict


def test_a_flight_that_was_fitted_is_not_read_again(sondes, asked):
    spec, low = alone(sondes), sondes.flights["low"]
    forecast(spec, {}, low.changed(roles=("predict",)), None, None, None)
    assert asked.forecast == [(spec, spec.flights[0])] and asked.read == []


@pytest.mark.parametrize("change", [{"rate": 2.0}, {"window": (0.0, 9.0)}, {"capsule_mass": 3.0}])
def test_another_flight_with_the_name_of_a_fitted_one_is_refused(sondes, asked, change):
    with pytest.raises(bc.InputError, match="flight low: got the name of a fitted flight; .*flight.changed"):
        forecast(alone(sondes), {}, sondes.flights["low"].changed(**change), None, None, None)
    assert asked.forecast == []


def test_a_record_in_memory_must_be_that_which_was_fitted(sondes, asked, monkeypatch):
    low = sondes.flights["low"]
    record = low.record
    again = bc.Flight.of_study(low.study, low.spec, record)
    object.__setattr__(again, "_prepared", (record, None))
    monkeypatch.setattr(module, "load_flight", lambda job, name: {"low": record}[name])
    assert forecast(alone(sondes), {}, again, None, None, None) == "forecast"
    monkeypatch.setattr(module, "load_flight", lambda job, name: record.assign(altitude=record["altitude"] + 1.0))
    with pytest.raises(bc.InputError, match="the name of a fitted flight"):
        forecast(alone(sondes), {}, again, None, None, None)


def test_vehicles_are_told_apart(asked):
    """A fitted flight with another vehicle is another flight; a new one brings its own only where it differs."""
    study = bc.Study.example()
    one, *_ = study.flights
    spec = replace(study.spec, flights=(one.spec,))
    vehicle = study.vehicle.model_copy(update={"name": "another"})
    with pytest.raises(bc.InputError, match="the name of a fitted flight"):
        forecast(spec, {}, one.changed(vehicle=vehicle), None, None, None)
    forecast(spec, {}, one.changed(vehicle=study.vehicle), None, None, None)
    forecast(spec, {}, one.changed(name="new", vehicle=vehicle), None, None, None)
    forecast(spec, {}, one.changed(name="new", vehicle=study.vehicle), None, None, None)
    assert [flight.vehicle for _, flight in asked.forecast] == [None, vehicle, None]


def test_of_several_bodies_one_is_named_and_comes_first(sondes, asked):
    new = sondes.flights["high"].changed(name="new")
    with pytest.raises(bc.InputError, match="flight new: got a posterior of 2 bodies; .* Say like='low' in Python"):
        forecast(sondes.spec, {}, new, None, None, None)
    with pytest.raises(bc.InputError, match="like: got 'middle'; wanted one of low, high"):
        forecast(sondes.spec, {}, new, None, None, "middle")
    for like, names in (("high", ["high", "low", "new"]), ("low", ["low", "high", "new"])):
        forecast(sondes.spec, {}, new, None, None, like)
        assert [f.name for f in asked.forecast[-1][0].flights] == names
    forecast(alone(sondes), {}, new, None, None, "low")
    assert [f.name for f in asked.forecast[-1][0].flights] == ["low", "new"]


def test_where_parameters_are_shared_none_is_named(asked):
    """Unless a cluster's drops differ from each other."""
    study = bc.Study.example()
    spec = replace(study.spec, priors=study.spec.priors.model_copy(update={"vary": None}))
    new = study.flights[0].changed(name="new")
    forecast(spec, {}, new, None, None, None)
    assert [f.name for f in asked.forecast[0][0].flights] == [f.name for f in spec.flights] + ["new"]
    with pytest.raises(bc.InputError, match="like: got 'cdt-3-11'; wanted no name: all fitted flights share"):
        forecast(spec, {}, new, None, None, "cdt-3-11")
    vary = replace(spec, priors=spec.priors.model_copy(update={"vary": ("axial[1]",)}))
    forecast(vary, {}, new, None, None, "cdt-3-11")
    assert len(asked.forecast) == 2


@pytest.mark.parametrize("flight", ["low", None, 3])
def test_what_is_no_flight_is_refused(sondes, flight):
    with pytest.raises(bc.InputError, match="flight: got .*; wanted a Flight. Take one of a study"):
        forecast(sondes.spec, {}, flight, None, None, None)


def test_its_draws_are_those_that_bands_are_made_of(shared_out):
    made = shared_out._prediction
    assert isinstance(made, bands.Prediction) and made.last.shape == (101, 3) and np.isnan(made.last).all()
    assert made.draws["descent_rate"] is not None and made.failed == 0 and made.shares is shared_out.shares
