"""Panels of the figures: whoever gives axes gets them back, drawn on, and nothing else of the figure is touched."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from IPython.core.formatters import DisplayFormatter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayeschute.report import failed_fit, figures
from bayeschute.report.figures import behaviour_figures, canvas, inference_figures, predictive_figures, record_figures

MODULES = [
    failed_fit,
    *(importlib.import_module(f"{figures.__name__}.{one.name}") for one in pkgutil.iter_modules(figures.__path__)),
]
RNG = np.random.default_rng(3)
DRAWS = RNG.standard_normal((4, 200))
SHARES = xr.DataArray([[0.6], [0.4]], {"source": ["parameter", "wind"], "quantity": ["swing_angle"]})
PANELS = {
    "marginal": lambda ax: inference_figures.marginal(ax, "C_A0", DRAWS, 2.0 * DRAWS, 0.1),
    "trace": lambda ax: inference_figures.trace(ax, DRAWS),
    "ranks": lambda ax: inference_figures.ranks(ax, DRAWS),
    "autocorrelation": lambda ax: inference_figures.autocorrelation(ax, "swing", np.arange(3.0), np.ones(3)),
    "predicted error": lambda ax: inference_figures.predicted_error(
        ax, "axial", {"ranking": [{"mse": 2.0, "pse": 2.5}, {"mse": 1.0, "pse": 1.8}], "pse_minimum_at": 2}
    ),
    "p-values": lambda ax: predictive_figures.p_values(ax, [{"statistic": "runs", "p": 0.2}], 0.01),
    "PIT": lambda ax: predictive_figures.pit_histogram(ax, np.array([9.0, 11.0])),
    "variance": lambda ax: record_figures.variance(ax, {"a": SHARES}),
    "swing": lambda ax: behaviour_figures.swing(ax, np.arange(9.0), np.ones(9)),
    "portrait": lambda ax: behaviour_figures.phase_portrait(ax, np.ones(9), np.ones(9), "swing angle"),
}


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__.rsplit(".", 1)[-1])
def test_what_takes_axes_first_returns_axes(module):
    for name, function in inspect.getmembers(module, inspect.isfunction):
        first = next(iter(inspect.signature(function).parameters), "")
        if function.__module__ == module.__name__ and first in ("ax", "axes") and name[0] != "_":
            if module is not canvas:
                assert inspect.signature(function).return_annotation == "Axes", f"{module.__name__}.{name}"


@pytest.mark.parametrize("name", PANELS)
def test_a_panel_is_drawn_on_the_axes_given_and_nowhere_else(name):
    before = dict(mpl.rcParams)
    figure = Figure()
    ours, other = figure.subplots(1, 2)
    drawn = PANELS[name](ours)
    assert drawn is ours and drawn.has_data()
    assert figure.axes == [ours, other] and not other.has_data()
    assert dict(mpl.rcParams) == before


def test_a_legend_above_all_axes_has_an_entry_per_label():
    figure, axes = canvas.sheet(2.0, 1, 2)
    for ax in axes:
        ax.plot([0, 1], label="record")
    axes[1].plot([1, 0], label="truth")
    canvas.legend_of(axes)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["record", "truth"]


def test_axes_of_your_own_are_kept_and_new_ones_have_a_sheet_of_their_own():
    mine = Figure().add_subplot()
    assert canvas.axes_or_new(mine) is mine
    made = canvas.axes_or_new(None, 5.0, 4.0)
    shown, _ = DisplayFormatter().format(made)
    assert shown["image/png"].startswith(b"\x89PNG"), "a notebook would show its name only"
    assert isinstance(made, Axes) and list(made.figure.get_size_inches()) == [5.0, 4.0]
