"""Panels of aerodynamic curves: where they are extrapolated, whose they are, and in what unit."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from bayeschute.report.figures import canvas
from bayeschute.report.figures.curve_figures import curve, curve_figure, shown_axis

AT = np.linspace(0.0, 0.5, 6)
KNOWN = {"kind": "curve", "target": "C_A", "name": "tunnel $", "at": [0.2], "values": [1.5], "sd": [0.1]}


def band(middle, half):
    return np.full(6, middle - half), np.full(6, middle), np.full(6, middle + half)


def panel(**more):
    return curve(
        Figure().add_subplot(), "alpha", "rad", AT, {"posterior": band(1.0, 0.1)} | more.pop("bands", {}), **more
    )


def lines(axes, label):
    return [line for line in axes.lines if line.get_label() == label]


def test_an_angle_is_shown_in_degrees_and_a_share_without_a_unit():
    scale, label = shown_axis("alpha", "rad")
    assert scale == pytest.approx(180.0 / np.pi) and label == "total angle of attack [deg]"
    assert shown_axis("V", "1") == (1.0, "V [1]")


def test_the_median_is_solid_only_where_it_was_flown():
    axes = panel(flown=(0.1, 0.3))
    (solid,) = lines(axes, "median")
    np.testing.assert_allclose(solid.get_xdata(), np.rad2deg(AT))
    np.testing.assert_array_equal(np.isfinite(solid.get_ydata()), [False, True, True, True, False, False])
    (dotted,) = [line for line in axes.lines if line.get_linestyle() == ":"]
    np.testing.assert_allclose(dotted.get_ydata(), 1.0)
    (span,) = axes.patches
    np.testing.assert_allclose([span.get_x(), span.get_x() + span.get_width()], np.rad2deg([0.1, 0.3]))
    assert not panel(flown=(0.0, 0.5)).patches


def test_what_others_know_has_bars_of_ninety_per_cent_at_its_place():
    axes = panel(flown=(0.0, 0.5), known=[KNOWN])
    (bars,) = axes.containers
    (ends,) = bars.lines[2][0].get_segments()
    np.testing.assert_allclose(ends, [[np.rad2deg(0.2), 1.5 - 0.1645], [np.rad2deg(0.2), 1.5 + 0.1645]])
    assert bars.get_label() == r"tunnel \$, 90 %"


def test_limits_show_posterior_knowledge_and_truth_and_no_wide_prior():
    assert panel(flown=(0.0, 0.5), bands={"prior": band(1.0, 50.0)}).get_ylim() == pytest.approx((0.83, 1.17))
    span = 1.7 - 0.9  # two standard deviations of what is known
    want = (0.9 - 0.35 * span, 1.7 + 0.35 * span)
    assert panel(flown=(0.0, 0.5), known=[KNOWN]).get_ylim() == pytest.approx(want)
    assert panel(flown=(0.0, 0.5), truth=np.full(6, 3.1)).get_ylim()[1] == pytest.approx(3.1 + 0.35 * 2.2)
    flat = curve(Figure().add_subplot(), "V", "1", AT, {"posterior": band(2.0, 0.0)}, (0.0, 0.5))
    assert flat.get_ylim() == pytest.approx((1.3, 2.7))


def rows(name, symbol, at, **values):
    quantiles = {"posterior_q05": 0.5, "posterior_q50": 1.0, "posterior_q95": 2.0}
    return pd.DataFrame({"curve": name, "symbol": symbol, "unit": "1", "at": at, **quantiles, **values})


def test_every_curve_has_its_own_range_its_own_knowledge_and_its_quantiles_in_order():
    table = pd.concat([rows("C_N", "a", AT, truth=1.2), rows("C_A", "b", AT, truth=np.nan)])
    other = KNOWN | {"kind": "coefficient"}
    figure = curve_figure(table, [KNOWN, other], {"C_N": "normal force"}, {"a": (0.1, 0.3)})
    first, second = figure.axes
    assert (first.get_title("left"), second.get_title("left")) == ("C_N: normal force", "C_A")
    assert len(first.patches) == 1 and not second.patches  # the whole grid where no range is told
    assert not first.containers and len(second.containers) == 1
    assert len(lines(first, "truth")) == 1 and not lines(second, "truth")
    (median,) = lines(second, "median")
    np.testing.assert_allclose(median.get_ydata(), 1.0)
    low, high = second.collections[0].get_paths()[0].get_extents().intervaly
    assert (low, high) == pytest.approx((0.5, 2.0)) and to_hex(median.get_color()).upper() == canvas.BLUE
