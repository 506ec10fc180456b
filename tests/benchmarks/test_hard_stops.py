"""Folders of runs compared to the last bit, and the rows of runs that were stopped."""

from __future__ import annotations

import json
import shutil

import hard_stops
import numpy as np
import pandas as pd
import pytest
import run_differences
import stop_kinds
import xarray as xr

from bayeschute.study.load import examine_study

SAMPLING = {"divergences": 0, "wall_s": 3.0, "wall": {"fit_s": 4.0}, "min_ess_per_s": 50.0}
PAGE = """<html>
<tr><td class="text ">wall time [s]</td><td class="text wrap">{seconds}</td></tr>
<tr><td class="text ">divergent transitions</td><td class="text wrap">{divergences}</td></tr>
</html>
"""


@pytest.fixture
def whole(tmp_path):
    """A folder with files of the kinds that runs leave."""
    folder, rng = tmp_path / "whole", np.random.default_rng(0)
    for name in ("risk", "fit", ".stages"):
        (folder / name).mkdir(parents=True)
    draws = xr.Dataset({"drag": (("chain", "draw"), rng.standard_normal((2, 50)), {"units": "m^2/kg"})})
    band = xr.Dataset({"descent_rate": ("time", rng.standard_normal(9).astype("f4"))})
    band["descent_rate"][0] = np.nan
    groups = {"posterior": draws.assign_attrs(created_at="2026-01-01"), "prior": 2.0 * draws}
    xr.DataTree.from_dict(groups).to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    xr.DataTree.from_dict({"low": band}).to_netcdf(folder / "predictions.nc", engine="h5netcdf")
    np.savez(folder / "fit" / "low.npz", xi=rng.standard_normal(3), name="low")
    pd.DataFrame({"drag": rng.standard_normal(4), "flight": "low"}).to_parquet(folder / "risk" / "draws.parquet")
    (folder / "risk" / "draws.csv").write_text("drag\n0.15\n", encoding="utf-8")
    (folder / ".stages" / "fit").write_text("0a1b", encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps({"flights": ["low"], "sampling": SAMPLING}), encoding="utf-8")
    (folder / "report.html").write_text(PAGE.format(seconds=3.1, divergences=0), encoding="utf-8")
    return folder


@pytest.fixture
def copy(whole, tmp_path):
    """The same once more."""
    return shutil.copytree(whole, tmp_path / "copy")


def _found(whole, copy, partial=False):
    return list(run_differences.differences(whole, copy, partial))


def _rewrite(path, **changed):
    summary = json.loads(path.read_text(encoding="utf-8"))
    summary["sampling"].update(changed)
    path.write_text(json.dumps(summary), encoding="utf-8")


def test_a_run_is_the_same_as_itself(whole, copy):
    assert _found(whole, copy) == [] and run_differences.unfinished(copy) == []


@pytest.mark.parametrize(
    ("name", "place", "size"), [("posterior.nc", "/prior/drag", 100), ("predictions.nc", "/low/descent_rate", 9)]
)
def test_a_bit_that_changed_is_found_with_its_place(whole, copy, name, place, size):
    tree = xr.load_datatree(copy / name, engine="h5netcdf")
    values = tree[place].values
    values.flat[3] = np.nextafter(values.flat[3], np.inf, dtype=values.dtype)
    tree.to_netcdf(copy / name, engine="h5netcdf")
    (line,) = _found(whole, copy)
    assert line.startswith(f"{name}: {place}: 1 of {size} values, first ")


def test_another_unit_and_another_kind_of_number_are_differences(whole, copy):
    tree = xr.load_datatree(copy / "posterior.nc", engine="h5netcdf")
    tree["/posterior/drag"].attrs["units"] = "m^2"
    tree["/prior"] = xr.DataTree(tree["prior"].to_dataset().astype("f4"))
    tree.to_netcdf(copy / "posterior.nc", engine="h5netcdf")
    found = "\n".join(_found(whole, copy))
    assert "/posterior/drag@units: 'm^2/kg', here 'm^2'" in found
    assert "/prior/drag: float64 [2, 50], here float32 [2, 50]" in found


def test_times_are_left_out_and_numbers_beside_them_are_not(whole, copy):
    tree = xr.load_datatree(copy / "posterior.nc", engine="h5netcdf")
    tree["posterior"].attrs["created_at"] = "2026-01-02"
    tree.to_netcdf(copy / "posterior.nc", engine="h5netcdf")
    _rewrite(copy / "summary.json", wall_s=6.0, wall={"fit_s": 7.0}, min_ess_per_s=25.0)
    (copy / "report.html").write_text(PAGE.format(seconds=9.9, divergences=0), encoding="utf-8")
    (copy / "log.txt").write_text("2026-01-02", encoding="utf-8")
    (whole / "log.txt").write_text("2026-01-01", encoding="utf-8")
    assert _found(whole, copy) == []
    _rewrite(copy / "summary.json", divergences=17)
    (copy / "report.html").write_text(PAGE.format(seconds=9.9, divergences=17), encoding="utf-8")
    page, number = _found(whole, copy)
    assert number == "summary.json: sampling/divergences: 0, here 17" and page.startswith("report.html: 3: ")


def test_missing_further_and_cut_files_are_told(whole, copy):
    (copy / "risk" / "draws.csv").unlink()
    (copy / "more.csv").write_text("1", encoding="utf-8")
    for name in ("summary.json", "posterior.nc", "fit/low.npz", "risk/draws.parquet", "report.html"):
        path = copy / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (copy / "fit" / ".facts.part.json").write_text("{", encoding="utf-8")
    found = [line.split(": ")[:2] for line in _found(whole, copy)]
    assert found[:2] == [["risk/draws.csv", "missing"], ["more.csv", "not in the reference"]]
    cut = ["fit/low.npz", "posterior.nc", "report.html", "risk/draws.parquet", "summary.json"]
    assert found[2:] == [[name, "can't be read"] for name in cut]
    assert [line.split(": ")[0] for line in _found(whole, copy, partial=True)] == cut
    assert run_differences.unfinished(copy) == ["fit/.facts.part.json"]


def test_rows_go_on_after_one_that_was_cut(tmp_path):
    path = tmp_path / "rows.jsonl"
    hard_stops.add(path, {"identity": "a", "number": 0})
    with path.open("ab") as file:
        file.write(b'{"identity": "a", "num')
    hard_stops.add(path, {"identity": "a", "number": 1})
    hard_stops.add(path, {"identity": "b", "number": 2})
    assert [row["number"] for row in hard_stops.known(path, "a")] == [0, 1]


def test_the_made_up_study_has_no_fault(tmp_path):
    found = examine_study(hard_stops.made_up(tmp_path / "study"), None)
    assert not found.faults
    assert [flight.name for flight in found.study.flights] == ["low", "high"]


def test_the_stage_under_way_is_the_last_one_that_the_log_tells_of(tmp_path):
    assert stop_kinds.under_way(tmp_path) == "before the first stage"
    when = "2026-01-01 00:00:00+0000       2.0 s"
    lines = (f"{when}  fit        40 %  low: draws (about 3 s left)", f"{when}  ended by OSError: no", "2026-01")
    (tmp_path / "log.txt").write_text("\n".join(lines), encoding="utf-8")
    assert stop_kinds.under_way(tmp_path) == "fit 40 % low: draws (about 3 s left)"


def test_as_a_command_it_ends_with_one_where_runs_differ(whole, copy, tmp_path, monkeypatch, capsys):
    def told(*given):
        monkeypatch.setattr("sys.argv", ["run_differences.py", *map(str, given)])
        with pytest.raises(SystemExit) as end:
            run_differences.main()
        return end.value.code, capsys.readouterr().out.splitlines()

    assert told(whole, copy) == (0, ["0 differences"])
    assert told(whole, copy, "--json") == (0, ["[]"])
    _rewrite(copy / "summary.json", divergences=2)
    code, (line, last) = told(whole, copy)
    assert code == 1 and line.startswith("summary.json: sampling/divergences") and last == "1 differences"
    assert told(whole, tmp_path / "none")[0] == 2
