"""Cleaning: each kind of fault is found and listed, and good records pass untouched."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayeschute.core.errors import InputError
from bayeschute.records.clean import clean, repairs
from bayeschute.records.record import load_record, make_record, write_record

DT = 0.1
T = np.round(np.arange(600) * DT, 10)


def fall(seed=0, sd=0.2, t=T):
    """A descent at 12 m/s that slows down, with noise."""
    rng = np.random.default_rng(seed)
    return 2000 - 12 * t + 0.02 * t**2 + 3 * np.sin(0.5 * t) + sd * rng.standard_normal(t.size)


def kinds(ds, *wanted):
    return [(r.kind, r.variable) for r in repairs(ds) if not wanted or r.kind in wanted]


def swinging(seed=0, n=2):
    """Positions of a cluster that swings by 20 deg, with videogrammetry noise."""
    rng = np.random.default_rng(seed)
    swing = 0.35 * np.sin(0.43 * T)
    up = 70 * np.stack([np.sin(swing), 0.2 * np.sin(0.2 * T), -np.cos(swing)], -1)
    at = np.stack([3 * T, -T, 10 * T], -1)
    return (at + up)[:, None] + 10 * np.arange(n)[:, None] + 0.3 * rng.standard_normal((T.size, n, 3))


def test_a_good_record_passes_untouched():
    z, p = fall(), swinging()
    out = clean(make_record(time=T, altitude=z, canopy_position=p), 10)
    np.testing.assert_array_equal(out["altitude"], z)
    np.testing.assert_array_equal(out["canopy_position"], p)
    assert repairs(out) == ()


def test_a_change_of_drag_is_no_fault():
    """A reefed canopy opens: the rate falls from 60 to 10 m/s within half a second."""
    rate = 10 + 50 / (1 + np.exp((T - 30) / 0.1))
    z = 4000 - np.cumsum(rate) * DT + 0.3 * np.random.default_rng(0).standard_normal(T.size)
    assert repairs(clean(make_record(time=T, altitude=z), 10)) == ()


@pytest.mark.parametrize("size", [-400.0, 15.0, 8.0])
@pytest.mark.parametrize("count", [1, 3])
def test_spikes_are_dropped_and_bridged(size, count):
    z = fall()
    z[300 : 300 + count] += size
    out = clean(make_record(time=T, altitude=z), 10)
    assert kinds(out, "spike", "level_shift") == [("spike", "altitude")]
    (spike,) = [r for r in repairs(out) if r.kind == "spike"]
    assert (spike.start, spike.end, spike.count) == (T[300], T[299 + count], count)
    np.testing.assert_allclose(out["altitude"], fall(), atol=3.0)
    assert ("interpolated", "altitude") in kinds(out)


@pytest.mark.parametrize("size", [-141.0, 30.0, 9.0])
def test_a_shifted_level_is_marked_and_not_corrected(size):
    z = fall()
    z[300:] += size
    out = clean(make_record(time=T, altitude=z), 10)
    (shift,) = [r for r in repairs(out) if r.kind == "level_shift"]
    assert (shift.start, shift.end) == (T[299], T[300])
    assert "not corrected" in shift.detail
    assert np.isnan(out["altitude"].values[299:301]).all()
    kept = np.delete(np.arange(T.size), [299, 300])
    np.testing.assert_array_equal(out["altitude"].values[kept], z[kept])


def test_a_step_across_a_gap_is_judged_by_the_motion_before_and_after():
    """14 m/s for 7 s are 98 m; the 42 m more are a shift of level (as in a logged sonde), 98 m are none."""
    for extra, found in ((0.0, []), (-42.0, [("level_shift", "altitude")])):
        z = 9000 - 14 * T + 0.4 * np.random.default_rng(3).standard_normal(T.size)
        z[300:] += extra
        z[231:300] = np.nan
        out = clean(make_record(time=T, altitude=z), 10)
        assert kinds(out, "level_shift", "spike") == found
        assert np.isnan(out["altitude"].values[232:299]).all()


def test_a_stuck_sensor_is_found():
    z = fall(sd=0.1)
    z[200:240] = z[200]
    out = clean(make_record(time=T, altitude=z), 10)
    (stuck,) = [r for r in repairs(out) if r.kind == "stuck"]
    assert (stuck.start, stuck.count) == (T[201], 39)
    assert np.isnan(out["altitude"].values[201:239]).all()


@pytest.mark.parametrize(("repeated", "stuck"), [(0.04, True), (0.08, False)])
def test_a_rough_channel_is_stuck_only_where_it_seldom_repeats_a_value(repeated, stuck):
    """A tension in coarse steps stays at one for a while without a fault."""
    rng = np.random.default_rng(2)
    tension = 1e4 + rng.standard_normal((T.size, 1))
    again = np.flatnonzero(rng.random(T.size - 1) < repeated) + 1
    tension[again] = tension[again - 1]
    tension[200:212] = tension[200]
    assert np.mean(np.diff(tension[:, 0]) == 0.0) == pytest.approx(repeated, abs=0.02)
    found = kinds(clean(make_record(time=T, riser_tension=tension), 10), "stuck")
    assert bool(found) == stuck


def test_a_slow_quantised_channel_is_not_stuck():
    temperature = np.round(280 + 0.05 * T, 1)
    assert repairs(clean(make_record(time=T, temperature=temperature), 10)) == ()


def test_a_dead_sensor_that_holds_its_last_value_is_dropped_and_a_vehicle_at_rest_is_not():
    z = fall(sd=0.1)
    z[400:] = z[400]
    assert kinds(clean(make_record(time=T, altitude=z), 10), "stuck") == [("stuck", "altitude")]
    rest = 100 + 0.02 * np.random.default_rng(0).standard_normal(T.size)
    rest[100:200] = rest[99]
    assert repairs(clean(make_record(time=T, altitude=rest), 10)) == ()


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("pressure", np.where(np.arange(600) == 50, -999.0, 9e4 + 100 * T)),
        ("temperature", np.where(np.arange(600) == 50, 0.0, 280.0 + 0 * T)),
        ("latitude", np.where(np.arange(600) == 50, 99.0, 0.7 + 0 * T)),
    ],
)
def test_impossible_values_are_dropped(name, values):
    out = clean(make_record(time=T, **{name: values}), 10)
    assert kinds(out, "out_of_range") == [("out_of_range", name)]
    assert np.isfinite(out[name]).all()


def test_a_lone_sample_of_a_rough_channel_goes_and_a_snatch_load_stays():
    rng = np.random.default_rng(0)
    force = 9.8 + 0.3 * rng.standard_normal((T.size, 3))
    ringing = 150 * np.exp(-np.arange(40) / 12) * np.cos(np.arange(40) * 1.3)
    force[300:340, 0] += ringing
    force[450, 1] += 400
    out = clean(make_record(time=T, capsule_specific_force=force), 10)
    assert kinds(out, "spike") == [("spike", "capsule_specific_force")]
    assert next(r.start for r in repairs(out) if r.kind == "spike") == T[450]
    np.testing.assert_array_equal(out["capsule_specific_force"][300:340], force[300:340])


def test_a_component_lost_is_a_vector_lost_and_canopies_are_apart():
    p = swinging()
    p[100:103, 1, 2] = np.nan
    p[200:230, 0] = np.nan
    out = clean(make_record(time=T, canopy_position=p), 10)
    assert [(r.kind, r.variable, r.count) for r in repairs(out)] == [
        ("gap", "canopy_position.1", 30),
        ("interpolated", "canopy_position.2", 3),
    ]
    assert np.isfinite(out["canopy_position"].values[:, 1]).all()
    np.testing.assert_allclose(out["canopy_position"][100:103, 1], swinging()[100:103, 1], atol=2.0)


def test_one_bad_component_drops_the_sample():
    p = swinging(n=1)
    p[321, 0, 1] += 9.0
    out = clean(make_record(time=T, canopy_position=p), 10)
    assert kinds(out, "spike") == [("spike", "canopy_position.1")]


@given(lost=st.lists(st.tuples(st.integers(0, 199), st.integers(1, 30)), max_size=6), max_gap=st.floats(0.0, 3.0))
@settings(max_examples=40, deadline=None)
def test_gaps_are_bridged_up_to_max_gap_and_no_further(lost, max_gap):
    t, z = T[:200], 100 - 2 * T[:200]
    holed = z.copy()
    for start, length in lost:
        holed[start : start + length] = np.nan
    if np.isfinite(holed).sum() < 20:
        return
    out = clean(make_record(time=t, altitude=holed), 10, max_gap=max_gap)["altitude"].values
    present = np.flatnonzero(np.isfinite(holed))
    for i in range(200):
        before, after = present[present <= i], present[present >= i]
        known = before.size and after.size and (t[after[0]] - t[before[-1]] <= max(max_gap, 0.15) + 1e-9)
        assert np.isfinite(out[i]) == bool(known)
    seen = np.isfinite(out)
    np.testing.assert_allclose(out[seen], z[seen], atol=1e-9)


def test_default_gap_is_half_a_second_or_one_and_a_half_intervals():
    t = np.arange(100) * 0.5
    z = 1000 - 5 * t
    z[40] = np.nan
    out = clean(make_record(time=t, altitude=z), 2)["altitude"].values
    assert np.isnan(out[40]) and np.isfinite(np.delete(out, 40)).all()
    t, z = T, 1000 - 5 * T
    z[100:104] = np.nan
    z[200:205] = np.nan
    out = clean(make_record(time=t, altitude=z), 10)["altitude"].values
    assert np.isfinite(out[100:104]).all() and np.isnan(out[200:205]).all()


def test_averaging_removes_what_would_alias_and_keeps_a_line():
    t = np.arange(5000) * 0.01
    z = 500 - 7 * t + np.sin(2 * np.pi * 10 * t)
    out = clean(make_record(time=t, altitude=z), 10)
    np.testing.assert_allclose(out["altitude"][1:-1], 500 - 7 * out["time"][1:-1], atol=1e-2)
    assert kinds(out) == [("resampled", "altitude")]


def test_averages_are_not_biased_by_gaps():
    t = np.arange(5000) * 0.01
    z = 500 - 40 * t
    z[np.random.default_rng(0).random(t.size) < 0.5] = np.nan
    out = clean(make_record(time=t, altitude=z), 4)
    np.testing.assert_allclose(out["altitude"][1:-1], 500 - 40 * out["time"][1:-1], atol=1e-6)


def test_attitudes_follow_the_great_circle_whatever_their_sign():
    t = np.arange(200) * 0.1
    half = 0.8 * t
    q = np.stack([np.cos(half), np.sin(half), 0 * t, 0 * t], -1) * (1 + 0.01 * np.sin(t))[:, None]
    q[::3] *= -1
    out = clean(make_record(time=t, capsule_attitude=q), 37.0)["capsule_attitude"].values
    now = np.arange(len(out)) / 37.0
    want = np.stack([np.cos(0.8 * now), np.sin(0.8 * now), 0 * now, 0 * now], -1)
    np.testing.assert_allclose(np.abs(np.sum(out * want, 1)), 1.0, atol=1e-12)
    assert (np.sum(out[1:] * out[:-1], axis=1) > 0).all()


def test_attitudes_far_from_unit_length_are_dropped():
    q = np.tile([1.0, 0, 0, 0], (100, 1))
    q[50] *= 0.5
    out = clean(make_record(time=np.arange(100) * 0.1, capsule_attitude=q), 10)
    assert kinds(out, "out_of_range") == [("out_of_range", "capsule_attitude")]
    np.testing.assert_allclose(out["capsule_attitude"], np.tile([1.0, 0, 0, 0], (100, 1)))


def test_averaged_attitudes_have_unit_length():
    t = np.arange(1000) * 0.01
    q = np.stack([np.cos(t), np.sin(t), 0 * t, 0 * t], -1)
    out = clean(make_record(time=t, capsule_attitude=q), 10)["capsule_attitude"].values
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0)


def test_longitudes_cross_the_date_line():
    east = np.pi - 1e-4 + 1e-6 * T
    wrapped = np.mod(east + 3e-4 * T / 60 + np.pi, 2 * np.pi) - np.pi
    out = clean(make_record(time=T, longitude=wrapped), 7.0)
    assert repairs(out) == ()
    step = np.mod(np.diff(out["longitude"].values) + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(step, 6e-6 / 7, rtol=1e-6)


def test_window_and_skip():
    out = clean(make_record(time=T, altitude=fall()), 5, window=(10.0, 30.0), skip_first=4.0)
    assert (out["time"].values[0], out["time"].values[-1]) == (14.0, 30.0)
    skipped = repairs(out)[0]
    assert (skipped.kind, skipped.start, skipped.end, skipped.count) == ("skipped", 10.0, 14.0, 40)


def test_faults_outside_the_window_are_not_listed():
    z = fall()
    z[100] += 500
    assert kinds(clean(make_record(time=T, altitude=z), 10, window=(20, 50))) == []


def test_ends_without_samples_are_listed():
    z = fall()
    z[:50] = z[550:] = np.nan
    out = clean(make_record(time=T, altitude=z), 10)
    assert [(r.kind, round(r.start, 1), round(r.end, 1)) for r in repairs(out)] == [
        ("gap", 0.0, 5.0),
        ("gap", 54.9, 59.9),
    ]


def test_earlier_repairs_and_attributes_stay(tmp_path):
    record = make_record(time=T, altitude=fall()).assign_attrs(source="x")
    record["altitude"][300] += 100
    once = clean(record, 10)
    twice = clean(load_record(write_record(once, tmp_path / "r.nc")), 10)
    assert repairs(twice) == repairs(once) and twice.attrs["source"] == "x"


def test_an_empty_window_of_a_channel_can_be_written(tmp_path):
    z = fall()
    z[200:] = np.nan
    out = clean(make_record(time=T, altitude=z, density=1 + 0 * T), 10, window=(30, 50))
    assert np.isnan(out["altitude"]).all()
    assert load_record(write_record(out, tmp_path / "r.nc")).identical(out)


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"rate_hz": 0.0}, "positive rate"),
        ({"rate_hz": float("nan")}, "positive rate"),
        ({"rate_hz": 1e9}, "Change the window"),
        ({"rate_hz": 10, "window": (5.0, 5.0)}, "end after the start"),
        ({"rate_hz": 10, "window": (100.0, 200.0)}, "1 samples"),
        ({"rate_hz": 10, "skip_first": -1.0}, "skip_first"),
        ({"rate_hz": 10, "max_gap": -1.0}, "max_gap"),
    ],
)
def test_unfit_requests_are_refused(kwargs, word):
    with pytest.raises(InputError, match=word):
        clean(make_record(time=T, altitude=fall()), **kwargs)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_noise_alone_is_never_dropped(seed):
    rng = np.random.default_rng(seed)
    z = fall(seed, sd=rng.choice([0.0, 0.1, 1.0, 5.0]))
    z[rng.random(T.size) < rng.choice([0.0, 0.2, 0.6])] = np.nan
    assert kinds(clean(make_record(time=T, altitude=z), 10), "spike", "level_shift", "stuck") == []
