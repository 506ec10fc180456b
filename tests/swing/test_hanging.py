"""Bodies that hang, swing and spin, made by hand: what comes back is their swing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.twins import hanging_body as twin

from bayeschute.core.errors import InputError
from bayeschute.swing.hanging import attitudes, hanging_motion

DT = 0.01
t = np.arange(1500) * DT
TILT = np.stack([0.1 * np.exp(-0.1 * t) * np.sin(6.0 * t), 0.06 * np.exp(-0.1 * t) * np.cos(6.0 * t)], axis=1)
SPIN = -8.0 + 16.0 * t / t[-1]
MOUNTED = Rotation.from_euler("xyz", [40.0, 70.0, -25.0], degrees=True)


def match(made, wanted):
    """The rotation of the horizontal axes that brings one series onto the other, and what remains."""
    z, w = made @ [1.0, 1j], wanted @ [1.0, 1j]
    errors = []
    for candidate in (w, w.conj()):  # seen from above or from below
        turn = np.vdot(candidate, z)
        errors.append(np.sqrt(np.mean(np.abs(z - candidate * turn / abs(turn)) ** 2) / np.mean(np.abs(w) ** 2)))
    return min(errors)


def velocity(tilt):
    """Rate of the horizontal direction of the axis."""
    axis = Rotation.from_rotvec(np.column_stack([tilt, np.zeros(len(tilt))])).apply([0.0, 0.0, 1.0])
    return np.gradient(axis[:, :2], DT, axis=0)


@pytest.mark.parametrize("spin", [0.0 * t, SPIN, 12.0 + 0.0 * t])
def test_swing_comes_back_whatever_the_spin_and_the_mounting(spin):
    made = hanging_motion(*twin.log(TILT, spin, DT, MOUNTED), DT)
    assert match(made.rate[5:-5], velocity(TILT)[5:-5]) < 0.02
    np.testing.assert_allclose(np.abs(made.spin).mean(), np.abs(spin).mean(), atol=0.03)
    assert np.abs(MOUNTED.inv().apply(made.axis_b) - [0.0, 0.0, 1.0]).max() < 1e-6


def test_a_misaligned_axis_is_a_combination_of_the_regressors():
    # Spin that stays clear of the swing's frequency, so that plain least squares can tell them apart.
    rate, force = twin.log(TILT, 11.0 + 0.3 * t, DT, MOUNTED, offset=(0.05, -0.03))
    made = hanging_motion(rate, force, DT)
    assert match(made.rate[5:-5], velocity(TILT)[5:-5]) > 0.2
    columns = made.misalignment.reshape(-1, 2)
    coefficients = np.linalg.lstsq(columns, made.rate.reshape(-1), rcond=None)[0]
    assert np.hypot(*coefficients) == pytest.approx(np.hypot(0.05, 0.03), rel=0.15)
    aligned = made.rate - made.misalignment @ coefficients
    assert match(aligned[5:-5], velocity(TILT)[5:-5]) < 0.05


def test_tilt_is_the_integral_of_the_rate():
    made = hanging_motion(*twin.log(TILT, SPIN, DT, MOUNTED), DT)
    np.testing.assert_allclose(np.gradient(made.tilt, DT, axis=0)[5:-5], made.rate[5:-5], atol=0.01)


def test_short_gaps_are_bridged_and_marked():
    rate, force = twin.log(TILT, SPIN, DT, MOUNTED)
    rate[700:705], force[300:304] = np.nan, np.nan
    made = hanging_motion(rate, force, DT)
    assert np.isnan(made.rate[700:705]).all() and np.isfinite(np.delete(made.rate, range(700, 705), axis=0)).all()
    whole = np.isfinite(made.rate).all(axis=1)
    whole[:5] = whole[-5:] = False
    assert match(made.rate[whole], velocity(TILT)[whole]) < 0.02


def test_attitudes_are_rotations():
    R = attitudes(np.random.default_rng(0).standard_normal((200, 3)), 0.05)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12)
    turn = attitudes(np.tile([0.0, 0.0, 0.3], (11, 1)), 0.1)[-1]
    np.testing.assert_allclose(turn, Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r, f: (r[:, :2], f), "shapes"),
        (lambda r, f: (np.where(np.arange(1500)[:, None] < 40, np.nan, r), f), "a gap of 0.4"),
        (lambda r, f: (np.where((np.abs(t - 7.0) < 0.3)[:, None], np.nan, r), f), "Choose a window"),
        (lambda r, f: (r, np.nan * f), "no sample"),
        (lambda r, f: (r, f * np.sin(3.0 * t)[:, None]), "averages out"),
    ],
)
def test_bad_input(change, message):
    rate, force = twin.log(TILT, SPIN, DT, MOUNTED)
    with pytest.raises(InputError, match=message):
        hanging_motion(*change(rate, force), DT)
