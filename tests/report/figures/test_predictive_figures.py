"""The figure of predictive checks: a row per statistic, a histogram per channel."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb

from bayeschute.report.figures.canvas import BLUE, SOFT, VERMILION
from bayeschute.report.figures.predictive_figures import predictive_figure

CHECKS = [{"statistic": "mean", "p": 1e-20}, {"statistic": "mean", "p": 0.4}, {"statistic": "mean square", "p": 0.9}]


def test_what_is_beyond_the_bound_is_red_where_it_counts_and_grey_where_it_does_not():
    checks = [
        {"statistic": "mean", "p": p, "matters": counts} for p, counts in ((1e-9, True), (1e-9, False), (0.5, True))
    ]
    colours = predictive_figure(checks, {}, 0.01).axes[0].collections[0].get_facecolors()[:, :3]
    for got, want in zip(colours, (VERMILION, SOFT, BLUE), strict=True):
        np.testing.assert_allclose(got, to_rgb(want))


def test_rows_are_statistics_and_panels_are_channels():
    figure = predictive_figure(CHECKS, {"a": {"swing": [9, 11]}, "b": {"swing": [10, 10], "rate": [5, 5]}}, 0.01)
    left, swing, rate = figure.axes
    assert [text.get_text() for text in left.get_yticklabels()] == ["mean", "mean square"]
    assert [patch.get_height() for patch in swing.patches if patch.get_width() < 1.0] == [19.0, 21.0]
    assert rate.get_title(loc="left") == "rate" or rate.get_title() == "rate"
