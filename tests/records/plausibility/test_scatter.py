"""White noise told by a record: of known series, and beside what a study says."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from bayeschute.records.plausibility.scatter import scatter, scatter_of_channels

TIME = np.arange(0.0, 200.0, 0.1)


def test_scatter_is_that_of_the_white_part():
    rng = np.random.default_rng(1)
    series = 30.0 * np.sin(0.4 * TIME) + rng.normal(0.0, 0.2, TIME.size)
    assert scatter(series) == pytest.approx(0.2, rel=0.1)
    slower = 30.0 * np.sin(0.4 * TIME) + rng.normal(0.0, 0.2, TIME.size)
    slower[:400], slower[900:905] = np.nan, np.nan  # gaps are passed over
    assert scatter(slower) == pytest.approx(0.2, rel=0.1)
    assert np.isnan(scatter(series[:40]))


def test_channels_of_a_record_have_the_noise_that_was_added():
    rng = np.random.default_rng(2)
    swing = np.deg2rad(10.0) * np.stack([np.cos(0.4 * TIME), np.sin(0.4 * TIME), 0.0 * TIME], axis=1)
    turned = Rotation.from_rotvec(swing) * Rotation.from_rotvec(rng.normal(0.0, 2e-3, (TIME.size, 3)))
    attitude = turned.as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], TIME.size)[:, None]  # signs may jump
    fallen = np.cumsum(rng.normal(0.0, 5.0, (TIME.size, 3)), axis=0)  # of both: relative positions know nothing of it
    apart = 20.0 * np.sin(0.3 * TIME)[:, None, None] + rng.normal(0.0, 0.15, (TIME.size, 2, 3))
    record = xr.Dataset(
        {
            "capsule_position": (("time", "axis"), fallen),
            "canopy_position": (("time", "canopy", "axis"), fallen[:, None] + apart),
            "capsule_velocity": (("time", "axis"), 9.0 + rng.normal(0.0, 0.03, (TIME.size, 3))),
            "capsule_attitude": (("time", "component"), attitude),
            "descent_rate": ("time", np.round(9.0 + 0.0 * TIME)),  # tells none
        },
        {"time": TIME},
    )
    found = scatter_of_channels(record)
    assert found == {
        "canopy_position": pytest.approx(0.15, rel=0.1),
        "capsule_velocity": pytest.approx(0.03, rel=0.1),
        "capsule_attitude": pytest.approx(2e-3, rel=0.1),
    }
