"""Mistakes of a size: clocks, headings, gains and lengths are told with the number that they were made with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.records.plausibility.made_up import vehicle

from bayeschute.records.plausibility.estimated_mistakes import estimated_mistakes, later
from bayeschute.records.plausibility.evidence import Evidence

G = 9.80665
TIME = 0.1 * np.arange(600)


def _flat(_: Evidence) -> float:
    """No shift is better than another."""
    return 0.0


def _north(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def swinging() -> Evidence:
    """A capsule that circles and sways in a wind that turns with altitude; its accelerometers and load cells agree."""
    w = 0.9
    velocity = np.stack([4.0 * np.sin(w * TIME), 2.0 * np.sin(w * TIME + 1.0), 8.0 + 0.0 * TIME], axis=1)
    felt = w * np.stack([4.0 * np.cos(w * TIME), 2.0 * np.cos(w * TIME + 1.0), 0.0 * TIME], axis=1) - [0.0, 0.0, G]
    attitude = Rotation.from_rotvec(np.stack([0.2 * np.sin(TIME), 0.1 * TIME, 0.3 * np.cos(0.7 * TIME)], axis=1))
    wind = np.stack([5.0 - 0.05 * TIME, 2.0 + 0.05 * TIME, 0.0 * TIME], axis=1)
    force = attitude.inv().apply(felt)
    pull = 900.0 * np.linalg.norm(force, axis=1)
    position = np.stack([0.0 * TIME, 0.0 * TIME, 8.0 * TIME - 3000.0], axis=1)
    v = vehicle()
    attach = position + attitude.apply(v.attach_b)
    canopies = attach[:, None] + [[[3.0, 4.0, -12.0], [-3.0, -4.0, -12.0]]]
    return Evidence(
        time=TIME, velocity=velocity + wind, attitude=attitude.as_quat()[:, [3, 0, 1, 2]], force=force, wind=wind,
        tension=np.stack([0.6 * pull, 0.4 * pull], axis=1), position=position, canopies=canopies, vehicle=v,
    )  # fmt: skip


def _one(e: Evidence, words: str, score=_flat):
    found = [one for one in estimated_mistakes(e, score) if words in one.cause]
    return found[0] if found else None


def test_later_takes_what_stands_later_and_nothing_beyond_the_ends(swinging):
    made = later(replace(swinging, canopies=swinging.canopies * TIME[:, None, None]), ("canopies", "wind"), 2.0)
    np.testing.assert_allclose(made.wind[:500, 0], 5.0 - 0.05 * (TIME[:500] + 2.0))
    assert np.isnan(made.wind[-20:]).all() and np.isfinite(made.wind[:-20]).all()
    assert made.canopies.shape == swinging.canopies.shape and made.velocity is swinging.velocity
    np.testing.assert_allclose(made.canopies[100, 1, 1], swinging.canopies[120, 1, 1] * TIME[120])
    assert later(swinging, ("wind", "rate"), 1.0) is None


@pytest.mark.parametrize(
    ("shift", "told"), [(3.2, "3.2 s late"), (-1.1, "1.1 s early"), (0.1, None), (0.2, "0.2 s late")]
)
def test_a_clock_is_found_to_a_tenth_of_a_second(swinging, shift, told):
    """Load cells that show at t what was at t - shift."""
    rising = replace(swinging, tension=np.stack([TIME, TIME**2], axis=1))
    late = later(rising, ("tension",), -shift)

    def score(e: Evidence) -> float:
        return float(np.nanmean((e.tension - rising.tension) ** 2))

    one = _one(late, "load cells are", score)
    if told is None:
        assert one is None
        return
    assert one.cause == f"load cells are {told} on the clock of the others"
    assert one.do.endswith(f"shift them by {-shift:+.1f} s.")
    back = one.undone(late).tension
    np.testing.assert_allclose(back[100:400], rising.tension[100:400], rtol=1e-6)


def test_clocks_of_channels_that_lack_or_are_slow_are_not_sought(swinging):
    slow = replace(swinging, time=15.0 * TIME)

    def score(e: Evidence) -> float:
        return -1.0 if np.isnan(e.tension).any() else 0.0

    assert _one(swinging, "load cells are", score) is not None and _one(slow, "load cells are", score) is None
    assert _one(swinging, "angular rates and", lambda e: float(np.isfinite(e.force).mean())) is None


@pytest.mark.parametrize("angle", [12.0, -40.0])
def test_a_heading_that_is_off_is_turned_back(swinging, angle):
    turned = Rotation.from_euler("z", angle, degrees=True) * Rotation.from_quat(swinging.attitude[:, [1, 2, 3, 0]])
    off = replace(swinging, attitude=turned.as_quat()[:, [3, 0, 1, 2]])
    one = _one(off, "heading of the attitude")
    assert f"off by {angle:.0f} deg" in one.cause and one.do == f"Turn it about the vertical by {-angle:.0f} deg."
    back = one.undone(off).attitude
    np.testing.assert_allclose(np.abs(np.sum(back * swinging.attitude, axis=1)), 1.0, atol=1e-3)
    assert _one(swinging, "heading of the attitude") is None and _one(replace(off, force=None), "heading") is None


@pytest.mark.parametrize("angle", [30.0, -75.0])
def test_a_wind_of_another_north_is_turned_back(swinging, angle):
    off = replace(swinging, wind=swinging.wind @ _north(np.deg2rad(angle)).T)
    one = _one(off, "the wind is turned")
    assert f"by {angle:.0f} deg" in one.cause and one.do == f"Turn it by {-angle:.0f} deg."
    np.testing.assert_allclose(one.undone(off).wind, swinging.wind, atol=0.1)
    assert _one(swinging, "the wind is turned") is None


@pytest.mark.parametrize("wind_too", [True, False])
@pytest.mark.parametrize(
    ("level", "told"), [(430.0, "430 m too high: above another level"), (-350.0, "350 m too low: above the ground")]
)
def test_a_wind_profile_above_another_level_is_read_at_its_own(swinging, level, told, wind_too):
    def aloft(height):
        fallen = (3000.0 - height) / 8.0
        return np.stack([5.0 - 0.05 * fallen, 2.0 + 0.05 * fallen, 0.0 * fallen], axis=1)

    sound = replace(swinging, aloft=aloft).with_winds()
    off = replace(swinging, aloft=lambda height: aloft(height - level)).with_winds()
    if not wind_too:  # what the capsule goes with over some swings tells it less sharply
        sound, off = replace(sound, wind=None), replace(off, wind=None)
    one = _one(off, "altitudes of the wind profile")
    if wind_too:
        assert told in one.cause and one.do == f"Give altitudes above the sea: {-level:+.0f} m from those given."
    np.testing.assert_allclose(one.undone(off).profile, sound.profile, atol=0.1 if wind_too else 1.0)
    np.testing.assert_allclose(one.undone(off).shear, sound.shear, atol=1e-9)
    assert np.abs(off.profile - sound.profile).max() > 1.5
    if wind_too:
        assert _one(sound, "altitudes of the wind profile") is None
    assert _one(swinging, "altitudes of the wind profile") is None
    assert _one(replace(off, wind=np.nan * TIME[:, None] * np.ones(3)), "altitudes of the wind profile") is None


def test_load_cells_speak_for_a_mass_or_for_their_gain(swinging):
    light = replace(swinging, vehicle=replace(swinging.vehicle, mass=600.0))
    one = _one(light, "load cells say")
    assert "part of the payload is missing" in one.cause and "900 kg" in one.cause
    assert one.undone(light).vehicle.mass == pytest.approx(900.0)
    heavy = replace(swinging, vehicle=replace(swinging.vehicle, mass=1200.0))
    assert _one(heavy, "load cells say").cause == "the capsule's mass is too great: load cells say 900 kg"
    doubled = replace(swinging, tension=2.0 * swinging.tension)
    gain = _one(doubled, "gain of the load cells")
    mended = gain.undone(doubled).tension.sum(axis=1)
    assert np.median(mended) == pytest.approx(900.0 * G)
    share = np.median(doubled.tension.sum(axis=1)) / (900.0 * G)
    assert f"off: {share:.3g} of the weight" in gain.cause
    dead = replace(swinging, tension=0.0 * swinging.tension)
    assert _one(replace(dead, tension=np.nan * dead.tension), "load cells say") is None


def test_risers_are_as_long_as_they_are_seen(swinging):
    one = _one(swinging, "the risers are")
    assert one.cause == "the risers are 13 m long, not 20 m"
    assert one.undone(swinging).vehicle.riser_length == pytest.approx(13.0)
    assert _one(replace(swinging, canopies=None), "the risers are") is None
