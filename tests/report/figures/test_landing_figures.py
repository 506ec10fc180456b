"""Figures of landings: ellipses that hold the shares they say, bars in order, cells at their place."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from bayeschute.landing.decisions.requirements import Limit
from bayeschute.landing.measures import ROW
from bayeschute.report.figures import landing_figures as module


def ax():
    return Figure().add_subplot()


def landed(east, north):
    rows = np.zeros(east.size, ROW)
    rows["drift_east"], rows["drift_north"] = east, north
    return rows


def ellipses(axes):
    return [patch for patch in axes.patches if isinstance(patch, Ellipse)]


@pytest.fixture(scope="module")
def spread():
    """Landings along a line to the north-north-east, off the start."""
    law = np.array([[500.0**2, 0.9 * 500.0 * 1000.0], [0.9 * 500.0 * 1000.0, 1000.0**2]])
    return landed(*np.random.default_rng(2).multivariate_normal([300.0, -2000.0], law, 5000).T)


def test_an_ellipse_holds_its_share_of_the_landings(spread):
    axes = module.scatter(ax(), spread)
    found = ellipses(axes)
    places = np.stack([spread["drift_east"], spread["drift_north"]], axis=1)
    held = [np.mean(one.get_patch_transform().inverted().transform(places) ** 2 @ [1.0, 1.0] < 1.0) for one in found]
    assert held == pytest.approx([0.5, 0.9, 0.99], abs=0.015)
    assert all(one.height / one.width == pytest.approx(found[0].height / found[0].width) for one in found)


def test_landings_that_failed_lie_nowhere(spread):
    rows = np.concatenate([spread[:50], landed(np.full(3, np.nan), np.full(3, np.nan))])
    rows["outcome"][50:], rows["label"][50:] = 1, -1
    axes = module.scatter(ax(), rows)
    assert sum(line.get_xdata().size for line in axes.lines if line.get_label() == "steady") == 50
    assert np.isfinite(ellipses(axes)[0].center).all()


@pytest.mark.parametrize(("profiles", "count"), [(6, 18), (7, 3)])
def test_few_wind_profiles_have_ellipses_of_their_own(spread, profiles, count):
    rows = spread.copy()
    rows["profile"] = np.arange(rows.size) % profiles
    assert len(ellipses(module.scatter(ax(), rows))) == count


def exceeding(high=0.1):
    return pd.DataFrame(
        {"threshold": [1.0, 2.0], "probability": [0.05, 0.0], "posterior_low": 0.0, "posterior_high": 0.2,
         "clopper_pearson_low": 0.0, "clopper_pearson_high": [0.2, high]}
    )  # fmt: skip


def test_only_limits_on_the_quantity_are_drawn_and_lower_ones_too():
    limits = [Limit("vertical_speed", 12.0), Limit("hang_angle", 0.5), Limit("vertical_speed", None, 3.0)]
    axes = module.exceedance_curve(ax(), exceeding(), "vertical_speed", limits)
    upright = [line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1]
    assert upright == [12.0, 3.0] and axes.get_xlabel() == "vertical speed [m/s]"


def test_the_axis_of_probability_reaches_below_what_the_landings_tell():
    assert module.exceedance_curve(ax(), exceeding(0.1), "time").get_ylim()[0] == pytest.approx(3e-4)
    assert module.exceedance_curve(ax(), exceeding(1e-5), "time").get_ylim()[0] == pytest.approx(3e-6)
    (mean,) = [line for line in module.exceedance_curve(ax(), exceeding(), "time").lines if line.get_label() == "mean"]
    assert list(mean.get_ydata()) == pytest.approx([0.05, 3e-4])


def test_the_greatest_share_is_on_top_with_its_own_error():
    axes = module.tornado(ax(), {"a": 0.6, "b": 0.1, "c": 0.3}, {"a": 0.06, "c": 0.03})
    assert [bar.get_width() for bar in axes.patches] == [0.1, 0.3, 0.6]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["b", "c", "a"]
    ends = [segment[:, 0] for segment in axes.containers[0].lines[2][0].get_segments()]
    np.testing.assert_allclose(ends, [[0.1, 0.1], [0.27, 0.33], [0.54, 0.66]], atol=1e-12)


def cell(shear, mass, word):
    return SimpleNamespace(
        shear=shear, capsule_mass=mass, word=word, pendulum=SimpleNamespace(met=shear / 100.0, low=0.0, high=1.0)
    )


def test_a_cell_of_the_placard_stands_at_its_payload_and_its_shear():
    cells = [
        cell(6.0, 9000.0, "no-go"),
        cell(0.0, 9000.0, "go"),
        cell(6.0, 8000.0, "can't tell"),
        cell(0.0, 8000.0, "go"),
    ]
    axes = module.onset_map(ax(), cells)
    said = {text.get_position(): text.get_text().split("\n")[:2] for text in axes.texts}
    assert said == {
        (1, 1): ["no-go", "pendulum 6 %"], (1, 0): ["go", "pendulum 0 %"], (0, 1): ["can't tell", "pendulum 6 %"],
        (0, 0): ["go", "pendulum 0 %"],
    }  # fmt: skip
    assert [t.get_text() for t in axes.get_xticklabels()] == ["8000", "9000"]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["0.0", "6.0"]
    assert [tuple(p.get_xy() + np.array([0.5, 0.5])) for p in axes.patches] == [(1, 1), (1, 0), (0, 1), (0, 0)]


def test_groups_stand_left_and_parameters_right_a_row_for_each_quantity():
    told = [
        (q, kind, f"{kind} of {q}", 0.5, np.nan)
        for q in ("hang_angle", "time")
        for kind in ("first", "shapley", "total")
    ]
    table = pd.DataFrame(told, columns=["quantity", "kind", "source", "share", "standard_error"])
    figure = module.drivers_figure(table)
    said = [(a.get_title("left"), [t.get_text() for t in a.get_yticklabels()]) for a in figure.axes]
    assert said == [
        ("hang angle: groups, total", ["total of hang_angle"]), ("hang angle: parameters", ["shapley of hang_angle"]),
        ("time: groups, total", ["total of time"]), ("time: parameters", ["shapley of time"]),
    ]  # fmt: skip
