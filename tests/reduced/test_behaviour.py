"""What the planar pendulum must do (report 7.1, CHECKCASES 14, findings F-1..F-4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.aero.published import load_published
from bayeschute.core.units import to_si
from bayeschute.reduced import behaviour
from bayeschute.reduced.motion import dumbbell
from bayeschute.reduced.published_models import planar_aero
from bayeschute.verification.sets import T71

FEET = 1.0 / to_si("1 ft", "m")
AERO = planar_aero(load_published("table-7.1-2"))
MODEL, RHO = dumbbell(T71), T71.density


def test_limit_cycle_of_the_published_set():
    found = behaviour.limit_cycle(MODEL, AERO, RHO)
    assert found.amplitude == pytest.approx(0.380, abs=0.005)
    assert found.frequency == pytest.approx(0.0698, abs=0.0005)
    assert found.descent_rate * FEET == pytest.approx(33.7, abs=0.2)


def test_small_disturbance_grows_to_the_same_cycle():
    """Figure 7.1-8: the canopies first seek a trim angle, swinging little, then cross over for good."""
    motion = behaviour.disturbed_descent(MODEL, AERO, RHO)
    early, late = motion.between(0.0, 20.0), motion.between(150.0)
    assert np.abs(early.swing).max() < 0.1 < np.abs(early.alpha).max()
    assert np.ptp(late.swing) / 2 == pytest.approx(0.380, abs=0.005)
    assert late.alpha.min() < -0.189 and late.alpha.max() > 0.189


def test_four_configurations_end_as_in_the_figures():
    both, dynamic, static, neither = behaviour.four_configurations(MODEL, AERO, RHO)
    assert (both.ending, dynamic.ending) == ("limit cycle", "limit cycle")
    assert both.cycle.amplitude == pytest.approx(0.4, abs=0.03)  # 7.1-10
    assert dynamic.cycle.amplitude < 0.2  # 7.1-11, about alpha = 0
    last = dynamic.motion.between(200.0)
    assert abs(last.alpha.max() + last.alpha.min()) < 1e-3
    assert static.ending == "glide"  # 7.1-12
    assert static.motion.alpha[-1] == pytest.approx(-0.189, abs=1e-6)
    assert neither.ending == "vertical descent"  # 7.1-13
    assert abs(neither.motion.alpha[-1]) < 1e-6
    for settled in (static, neither):
        assert settled.cycle is None
        assert abs(settled.motion.swing[-1]) < 1e-6


def test_flipped_damping_ends_in_a_glide():
    motion = behaviour.damping_flip(MODEL, AERO, RHO)
    assert np.diff(motion.time) == pytest.approx(0.1)
    assert np.ptp(motion.between(20.0, 50.0).swing) / 2 > 0.35
    assert np.abs(motion.between(160.0).swing).max() < 1e-3
    np.testing.assert_allclose(np.abs(motion.between(160.0).alpha), 0.189, atol=1e-3)
    peaks = [np.abs(motion.between(t, t + 15.0).swing).max() for t in range(50, 155, 15)]
    assert (np.diff(peaks) < 0.0).all()


def test_bistability():
    grid = [-0.3, -0.25, -0.15, -0.09, -0.05, -0.02, 0.05]
    found = behaviour.bistability(MODEL, AERO, RHO, grid)
    assert found.threshold == pytest.approx(-0.227, abs=1e-3)
    np.testing.assert_array_equal(found.bistable(), [False, False, True, True, True, True, False])
    locked = found.amplitude[3:6, -1]
    assert (locked > 0.255).all() and (locked < 0.31).all()  # CHECKCASES 14
    assert found.cycles()[:2].all() and not found.cycles()[-1].any()
    assert found.amplitude[3, 1] > 0.3 > 0.05 > found.amplitude[4, 1]  # 0.1 rad is enough at -0.09, not at -0.05


def test_onset_by_shear_needs_a_large_change_in_a_thin_layer():
    change, thickness = np.array([-16.0, -4.0, 0.0, 3.0, 16.0]), np.array([20.0, 300.0])
    found = behaviour.shear_onset(MODEL, replace(AERO, C_Nalphadot=-0.09), RHO, change, thickness)
    assert (found.amplitude[[0, 4], 0] > 0.25).all()
    assert (found.amplitude[1:4] < 0.05).all()
    assert (found.amplitude[:, 1] < 0.05).all()
    assert np.isfinite(found.onset[[0, 4], 0]).all() and np.isnan(found.onset[1:4]).all()
    assert np.abs(found.motion.swing[:, 2]).max() < 1e-9  # no shear, no swing


def test_onset_is_only_a_matter_of_time_with_the_published_damping():
    found = behaviour.shear_onset(MODEL, AERO, RHO, np.array([-16.0, -4.0, 1e-3, 3.0, 16.0]), np.array([20.0, 300.0]))
    np.testing.assert_allclose(found.amplitude, 0.380, atol=0.005)
    assert (found.onset[2] > found.onset[[0, 4]]).all()


def test_sensitivity_of_the_pivot_point():
    """F-1: less drag, F-3: more payload, F-4: less density bring it closer; each is paid with descent rate."""
    found = behaviour.pivot_sensitivity(MODEL, AERO, RHO, [0.9, 1.0, 1.1])
    assert found.distance[:, 1] * FEET == pytest.approx(195.67, abs=0.01)
    np.testing.assert_array_equal(np.sign(np.diff(found.distance)), [[-1, -1], [1, 1], [1, 1]])
    np.testing.assert_array_equal(np.sign(found.elasticity), [-1, 1, 1])
    central = (np.log(found.distance[:, 2]) - np.log(found.distance[:, 0])) / np.log(1.1 / 0.9)
    np.testing.assert_allclose(found.elasticity, central, rtol=0.02)
    np.testing.assert_array_equal(np.sign(np.diff(found.speed)), [[1, 1], [-1, -1], [-1, -1]])
    assert (found.decay < 0.0).all()  # F-2: dynamically unstable whatever the pivot point
    np.testing.assert_array_equal(np.sign(np.diff(found.swing)), np.sign(np.diff(found.distance)))
