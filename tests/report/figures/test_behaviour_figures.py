"""Figures of the behaviour studies show what the studies found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.reduced.behaviour import Bistability, Configuration, Onset, PivotSensitivity
from bayeschute.reduced.motion import Cycle, Motion
from bayeschute.reduced.planar import PlanarAero
from bayeschute.report.figures import behaviour_figures as draw

TIME = np.arange(0.0, 100.0, 0.1)
AERO = PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)


def made(*batch):
    swing = np.broadcast_to(0.3 * np.sin(0.44 * TIME).reshape(-1, *(1,) * len(batch)), (len(TIME), *batch))
    return Motion(TIME, swing, 0.44 * swing, 0.5 * swing, 0.2 * swing, 10.0 + swing, swing)


def curve(axes, i=0):
    return np.array(axes.lines[i].get_data(), dtype=float)


@pytest.mark.parametrize("trim, dots", [(0.189, 2), (0.0, 1)])
def test_motion(trim, dots):
    figure = draw.motion_figure(made(), trim, flipped_at=50.0)
    left, right = figure.axes
    np.testing.assert_allclose(curve(left), [TIME, np.rad2deg(made().swing)])
    stable = [line for line in right.lines if line.get_label() == "stable trim"]
    assert len(stable[0].get_xdata()) == dots
    assert "damping" in left.texts[0].get_text()


def test_configurations():
    kinds = [(False, False, 0.189, "limit cycle"), (True, True, 0.0, "vertical descent")]
    found = [
        Configuration(s, d, t, made(), e, Cycle(0.38, 0.07, 10.0) if e == "limit cycle" else None)
        for s, d, t, e in kinds
    ]
    figure = draw.configuration_figure(found)
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles[:2] == ["Statically unstable, dynamically unstable", "Ends in a limit cycle, 21.8 deg at 0.070 Hz"]
    assert titles[2:] == ["Statically stable, dynamically stable", "Ends in a vertical descent"]


def test_curves():
    figure = draw.curves_figure(AERO, replace(AERO, statically_stable=True))
    alpha, normal = curve(figure.axes[0])
    np.testing.assert_allclose(normal, AERO.normal(np.deg2rad(alpha)), atol=1e-12)


def test_bistability():
    amplitude = np.array([[0.3, 0.3], [0.001, 0.28], [0.001, 0.002]])
    figure = draw.bistability_figure(
        Bistability(np.array([-0.3, -0.1, 0.1]), np.array([0.05, 0.45]), amplitude, amplitude, -0.2)
    )
    (axes,) = figure.axes
    np.testing.assert_allclose(curve(axes, 1), [[-0.3, -0.1, 0.1], np.rad2deg([0.3, 0.28, 0.002])])
    labels = [text.get_text() for text in figure.legends[0].texts]
    assert labels == ["bistable", "3 deg", "26 deg", "linear threshold"]


@pytest.mark.parametrize("shown", [(), [(0, 1), (1, 1)]])
def test_onset(shown):
    grid = np.full((3, 2), 0.2)
    found = Onset(np.array([-5.0, 0.0, 5.0]), np.array([30.0, 100.0]), grid, grid, grid * np.nan, 0.26, made(3, 2))
    figure = draw.onset_figure(found, shown)
    assert len(figure.axes) == 2 + len(shown)
    assert [t.get_text() for t in figure.legends[0].texts] == ["30 m thick", "100 m thick"]
    if shown:
        assert figure.axes[2].get_title("left") == "-5.0 m/s through 100 m"


def test_pivot():
    rows = np.arange(9.0).reshape(3, 3)
    figure = draw.pivot_figure(PivotSensitivity(np.array([0.9, 1.0, 1.1]), rows, rows, rows, -rows, rows, np.ones(3)))
    np.testing.assert_allclose(curve(figure.axes[0], 1)[1], rows[1])
    assert [t.get_text() for t in figure.legends[0].texts] == ["payload mass", "density", "drag"]
