"""Finished runs of the same study, compared: what the product itself wrote, and copies that differ by known amounts."""

from __future__ import annotations

import json
import shutil

import compare_numerics
import numpy as np
import pytest
import xarray as xr

from bayeschute.study.evidence.numerics_compared import BOUNDS


@pytest.fixture
def copy(finished, tmp_path):
    """A copy of a finished run."""
    return shutil.copytree(finished.folder, tmp_path / "copy")


def _changed(run, change):
    path = run / "summary.json"
    summary = json.loads(path.read_text(encoding="utf-8"))
    change(summary)
    path.write_text(json.dumps(summary), encoding="utf-8")


def test_a_run_is_the_same_as_itself(finished):
    made = compare_numerics.compared(finished.folder, finished.folder)
    assert [getattr(made, name) for name in BOUNDS._fields] == [0.0] * 4 and made.same
    assert made.study and len(made.hash) == 64 and made.seconds[0] == made.seconds[1] > 0.0


def test_shifts_and_widths_of_parameters_are_told_in_standard_deviations(finished, copy):
    def change(summary):
        one = next(iter(summary["parameters"].values()))
        one["mean"], one["sd"] = one["mean"] - 0.3 * one["sd"], 0.5 * one["sd"]

    _changed(copy, change)
    made = compare_numerics.compared(finished.folder, copy)
    assert made.mean == pytest.approx(0.3) and made.sd == pytest.approx(np.log(2.0)) and made.band == 0.0
    assert not made.same


def test_bands_are_compared_by_their_limits_and_widths(finished, copy):
    tree = xr.load_datatree(copy / "predictions.nc", engine="h5netcdf")
    name = next(n for n, node in tree.children.items() if node.attrs["role"] == "predict")
    band = tree[name]["descent_rate"]
    middle = band.sel(quantile=0.5)
    tree[name]["descent_rate"] = middle + 2.0 * (band - middle)
    tree.to_netcdf(copy / "predictions.nc", engine="h5netcdf")
    made = compare_numerics.compared(finished.folder, copy)
    assert made.width == pytest.approx(np.log(2.0), abs=1e-6) and 0.4 < made.band < 0.8 and made.mean == 0.0


@pytest.mark.parametrize("fault", ["study", "terms"])
def test_runs_of_other_studies_or_terms_are_not_compared(finished, copy, fault):
    def change(summary):
        if fault == "study":
            summary["hashes"]["study"] = "0" * 64
        else:
            summary["parameters"].popitem()

    _changed(copy, change)
    with pytest.raises(SystemExit, match="different studies" if fault == "study" else "different terms"):
        compare_numerics.compared(finished.folder, copy)
