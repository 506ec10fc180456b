"""Channels of a record beside what the laws compare them with: on motions where both are the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from bayeschute.records.plausibility.evidence import Evidence, Nominal
from bayeschute.records.plausibility.reading import FAULT, WARNING, Reading
from bayeschute.report.figures import canvas
from bayeschute.report.figures.plausibility_figures import Curve, Panel, channel, excess_by_law, panels

TIME = 0.1 * np.arange(300)
PULL = np.array([0.3, -0.2, 1.5])  # acceleration, NED [m/s^2]
GRAVITY = 9.80665
HALF = np.sqrt(0.5)
ON_ITS_SIDE = np.array([HALF, 0.0, HALF, 0.0])  # pitched up by 90 deg: body x points up
VEHICLE = Nominal(
    9000.0, np.array([-1.0, 0.0, 0.0]), np.ones(3), 5.0, 20.0, 1.0, 3, 900.0, 35.0, 100.0, 5000.0, 70.0, 3e5
)


@pytest.fixture
def falling():
    """A body on its side in constant acceleration, its three canopies with it."""
    velocity = np.array([2.0, 1.0, 5.0]) + TIME[:, None] * PULL
    position = np.array([0.0, 0.0, -4000.0]) + TIME[:, None] * [2.0, 1.0, 5.0] + 0.5 * TIME[:, None] ** 2 * PULL
    felt = PULL - np.array([0.0, 0.0, GRAVITY])
    force = np.array([-felt[2], felt[1], felt[0]])  # forward is up, right is east, below is north
    apart = np.array([[0.0, 0.0, -70.0], [0.0, 42.0, -56.0], [0.0, -42.0, -56.0]])
    return Evidence(
        TIME,
        position=position,
        velocity=velocity,
        attitude=np.tile(ON_ITS_SIDE, (TIME.size, 1)),
        rate=np.tile([0.1, 0.2, 0.3], (TIME.size, 1)),
        force=np.tile(force, (TIME.size, 1)),
        canopies=position[:, None] + [0.0, 0.0, 1.0] + apart,
        canopy_velocity=np.repeat(velocity[:, None], 3, axis=1),
        tension=np.full((TIME.size, 3), 9000.0 * GRAVITY / 3.0),
        altitude=-position[:, 2],
        density=np.full(TIME.size, 0.8),
        vehicle=VEHICLE,
    )


def by_title(e, used=None):
    return {panel.title: panel for panel in panels(e, used or e)}


def test_every_channel_lies_on_what_is_derived_from_others(falling):
    """A mean slope over an interval is the speed in its middle where the acceleration is constant."""
    shown = by_title(falling)
    compared = 0
    for panel in shown.values():
        recorded = None
        for curve in panel.curves:
            if curve.derived and panel.title != "Density":
                seen = np.interp(curve.time, recorded.time, recorded.values)
                np.testing.assert_allclose(curve.values, seen, rtol=1e-9, atol=1e-9)
                compared += 1
            recorded = recorded if curve.derived else curve
    assert compared == 1 + 3 + 9 + 3 + 1 + 1  # altitude, velocities, canopies, forces, load cells, risers


def test_units_are_those_of_the_axes(falling):
    shown = by_title(falling)
    rates = shown["Angular rate, body axes"]
    assert [float(c.values[0]) for c in rates.curves] == pytest.approx(
        np.rad2deg([0.1, 0.2, 0.3])
    ) and rates.unit == "deg/s"
    standard = shown["Density"].curves[1].values
    assert standard[0] == pytest.approx(0.8191, rel=1e-3)  # of the standard atmosphere at 4 km


def test_forces_without_an_attitude_are_told_by_their_size(falling):
    panel = by_title(replace(falling, attitude=None))["Size of the specific force"]
    assert float(panel.curves[0].values[0]) == pytest.approx(np.linalg.norm(PULL - [0.0, 0.0, GRAVITY]))


def test_a_recorded_wind_goes_before_one_by_altitude_and_neither_is_downward(falling):
    recorded, aloft = np.full((TIME.size, 3), 4.0), np.full((TIME.size, 3), 7.0)
    labels = [c.label for c in by_title(replace(falling, wind=recorded, profile=aloft))["Velocity north"].curves]
    assert labels == ["recorded", "d(position)/dt", "wind"]
    shown = by_title(falling, replace(falling, profile=aloft))
    assert shown["Velocity east"].curves[-1].label == "wind by altitude"
    assert len(shown["Velocity down"].curves) == 2
    assert panels(Evidence(TIME), Evidence(TIME)) == []


def test_bars_of_laws_have_the_colour_of_what_they_say():
    excess = [0.0, WARNING - 0.01, WARNING, FAULT, 1e4]
    axes = excess_by_law(Figure().add_subplot(), [Reading(f"law {i}", "", x, "", "") for i, x in enumerate(excess)])
    want = [canvas.BLUE, canvas.BLUE, canvas.ORANGE, canvas.VERMILION, canvas.VERMILION]
    assert [to_hex(bar.get_facecolor()).upper() for bar in axes.patches] == want
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([0.004, 0.69, 0.7, 1.0, 30.0])
    assert [t.get_text() for t in axes.get_yticklabels()][0] == "law 0" and axes.lines[0].get_xdata()[0] == FAULT


def test_times_that_are_not_used_are_shaded_and_long_records_thinned():
    time = np.linspace(0.0, 100.0, 10_000)
    axes = channel(Figure().add_subplot(), Panel("a", "m", [Curve("recorded", time, time, "k")]), (20.0, 90.0))
    low, high = axes.get_xlim()
    spans = [(p.get_x(), p.get_x() + p.get_width()) for p in axes.patches]
    assert spans == [pytest.approx((low, 20.0)), pytest.approx((90.0, high))]
    assert axes.lines[0].get_xdata().size == 2000 and axes.get_legend() is None
    assert not channel(Figure().add_subplot(), Panel("a", "m", [Curve("x", time, time, "k")]), (-50.0, 200.0)).patches
