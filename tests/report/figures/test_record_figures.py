from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bayeschute.report.figures import canvas, inference_figures, record_figures


@pytest.fixture
def bands():
    time = np.arange(10.0)
    quantiles = [0.05, 0.25, 0.5, 0.75, 0.95]
    values = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[:, None] + 0 * time
    truth = np.array([0, 1.5, 3, 0, 0, -3, 0, 0, 0, np.nan])
    return xr.Dataset(
        {
            "descent_rate": (("quantile", "time"), values, {"units": "m/s"}),
            "descent_rate_truth": ("time", truth),
            "held_out": ("time", time >= 5),
        },
        {"quantile": quantiles, "time": time},
    )


def test_coverage_scores_the_held_out_part(bands):
    assert record_figures.coverage(bands, "descent_rate", 0.05, 0.95) == 3 / 4
    everywhere = bands.drop_vars("held_out")
    assert record_figures.coverage(everywhere, "descent_rate", 0.05, 0.95) == 7 / 9
    assert record_figures.coverage(everywhere, "descent_rate", 0.25, 0.75) == 6 / 9
    assert record_figures.coverage(bands.drop_vars("descent_rate_truth"), "descent_rate", 0.05, 0.95) is None


def test_band_figure_shows_bands_truth_limit_and_shading(bands):
    figure = record_figures.band_figure(bands, {"descent_rate": 1.5})
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["90 % band", "50 % band", "median", "truth", "required limit", "held out of the fit"]
    assert figure.axes[0].get_title(loc="left") == "Descent rate"
    assert figure.axes[0].get_ylabel() == "[m/s]"
    whole = bands.assign(held_out=("time", np.ones(10, bool)))
    labels = [text.get_text() for text in record_figures.band_figure(whole).legends[0].get_texts()]
    assert "held out of the fit" not in labels


def test_a_limit_stands_upon_its_own_statistic_only():
    """One that is set on the mean of a quantity is none on its value at the end of the record."""
    rows = [
        {"run": "a", "quantity": "descent_rate", "statistic": s, "unit": "m/s", "threshold": t, "probability": p,
         "draws": 9, "clopper_pearson_low": p, "clopper_pearson_high": p}
        for s in ("final", "mean") for t, p in ((1.0, 0.9), (2.0, 0.1))
    ]  # fmt: skip
    figure = record_figures.exceedance_figure(pd.DataFrame(rows), {("descent_rate", "mean"): [1.5]})
    limited = {
        axes.get_title(loc="left"): [line.get_xdata()[0] for line in axes.lines if line.get_label() == "required limit"]
        for axes in figure.axes
    }
    assert limited == {"Descent rate,\nat the end of the record": [], "Descent rate,\nmean over the window": [1.5]}


def test_angles_are_drawn_in_degrees(bands):
    swing = bands.rename(descent_rate="swing_angle", descent_rate_truth="swing_angle_truth")
    swing["swing_angle"].attrs["units"] = "rad"
    figure = record_figures.band_figure(swing)
    assert figure.axes[0].get_ylabel() == "[deg]"
    assert figure.axes[0].lines[0].get_ydata()[0] == 0.0
    assert np.nanmax(figure.axes[0].lines[1].get_ydata()) == pytest.approx(np.degrees(3.0))


def test_ranks_of_chains_that_agree_are_even_and_of_one_that_does_not_are_not():
    rng = np.random.default_rng(2)
    draws = rng.normal(size=(4, 1000))
    counts = inference_figures.rank_counts(draws)
    assert counts.shape == (4, 20) and (counts.sum(axis=1) == 1000).all()
    assert abs(counts / 50 - 1).max() < 0.6
    draws[0] += 2.0
    assert inference_figures.rank_counts(draws)[0, -1] > 100


def test_a_record_without_anything_to_draw_gives_an_empty_figure():
    assert not record_figures.record_figure(xr.Dataset({"time": [0.0, 1.0]})).axes


def test_altitude_alone_is_enough():
    record = xr.Dataset({"altitude": ("time", [3.0, 2.0, 1.0])}, {"time": [0.0, 1.0, 2.0]})
    figure = record_figures.record_figure(record, [{"kind": "gap", "start": 0.5, "end": None}])
    assert len(figure.axes) == 1


def test_constant_draws_and_missing_priors_are_drawn():
    figure = inference_figures.marginal_figure(
        {"a": np.ones((2, 50)), "b": np.arange(100.0).reshape(2, 50)}, {}, {}, {}
    )
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["a", "b"]


def test_drawing_leaves_matplotlib_as_it_was(bands, tmp_path):
    before = dict(mpl.rcParams)
    path = canvas.save(record_figures.band_figure(bands), tmp_path / "f", "x")
    assert dict(mpl.rcParams) == before
    assert path.name == "x.svg"
    assert sorted(p.name for p in path.parent.iterdir()) == ["x.png", "x.svg"]
