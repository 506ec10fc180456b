"""Virtual drops over several processes: the same files whoever flies them, failures counted, finished drops kept."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import xarray as xr

from bayeschute.study.load import Study, load_study
from bayeschute.study.run import simulate as module
from bayeschute.study.run.simulate import Wanted, fly_drop, simulate_study
from bayeschute.virtual.drop import fly

dask = pytest.importorskip("dask", reason="Dask is not installed")
DRAWS = 3


def _contents(folder: Path) -> dict[str, str]:
    """What the files hold; their bytes also hold what happened to be in memory where HDF5 leaves gaps."""
    return {path.name: repr(xr.load_dataset(path, engine="h5netcdf").to_dict("array")) for path in folder.glob("c*.nc")}


@pytest.fixture
def drop(cluster: Path, spoil) -> Study:
    """Two virtual drops of ten seconds."""
    for _ in range(2):
        spoil(cluster, '^duration = "90 s"', 'duration = "10 s"')
    return load_study(cluster)


def dies_on_the_second(wanted: Wanted, study: Study):
    """Stands in for `fly_drop`; whoever is given the second drop of the first flight dies, every time."""
    if wanted.stem == "cdt-3-11.00001":
        os.kill(os.getpid(), 9)
    return fly_drop(wanted, study)


def test_two_workers_write_what_one_writes(drop: Study, tmp_path: Path):
    told: list[tuple[float, str]] = []
    one = simulate_study(drop, tmp_path / "one", draws=DRAWS)
    two = simulate_study(
        drop, tmp_path / "two", draws=DRAWS, workers=2, progress=lambda _, share, words: told.append((share, words))
    )
    kept = _contents(tmp_path / "one")
    assert _contents(tmp_path / "two") == kept and len(kept) == 2 * 2 * DRAWS
    assert [path.name for path in two.files] == [path.name for path in one.files]
    assert two._replace(files=[]) == one._replace(files=[])
    assert "left" in told[0][1] and told[-1] == (1.0, "6 of 6, 0 failed")


def test_a_drop_that_kills_its_workers_is_counted_and_no_other(drop: Study, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(module, "fly_drop", dies_on_the_second)
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):  # one death is enough: sooner done
        drops = simulate_study(drop, tmp_path / "f", draws=2, workers=2)
    assert drops.outcomes == {"ok": 3, "error": 1} and len(drops.files) == 6
    assert list(drops.failed) == ["cdt-3-11.00001"] and "worker lost" in drops.failed["cdt-3-11.00001"]
    monkeypatch.undo()
    again = simulate_study(drop, tmp_path / "f", draws=2)
    assert again.outcomes == {"ok": 4} and again.kept == 3


def test_a_drop_that_breaks_is_counted_and_the_others_are_flown(drop: Study, tmp_path: Path, monkeypatch):
    flights = []

    def breaks_once(*given):
        flights.append(given)
        if len(flights) == 2:
            raise RuntimeError("no\nmemory")
        return fly(*given)

    monkeypatch.setattr("bayeschute.study.run.stage_data.fly", breaks_once)
    drops = simulate_study(drop, tmp_path / "f", draws=2)
    assert drops.outcomes == {"ok": 3, "error": 1}
    assert drops.failed == {"cdt-3-11.00001": "RuntimeError: no memory"}


def test_finished_drops_are_kept_and_others_are_replaced(drop: Study, tmp_path: Path, monkeypatch):
    out, honest, flights = tmp_path / "f", fly, []
    first = simulate_study(drop, out, draws=2)
    whole, damaged = _contents(out), out / "cdt-3-12.00001.nc"
    (out / "cdt-3-12.00000.truth.nc").unlink()  # killed between the two files of a drop
    damaged.write_bytes(damaged.read_bytes()[:100])
    (out / ".cdt-3-12.00002.part.nc").write_bytes(b"cut")

    def watched(*given):
        flights.append(given)
        return honest(*given)

    monkeypatch.setattr("bayeschute.study.run.stage_data.fly", watched)
    again = simulate_study(drop, out, draws=2)
    assert len(flights) == 2 and again.kept == 2
    assert again._replace(kept=0) == first
    more = simulate_study(drop, out, draws=DRAWS)
    assert len(flights) == 4 and more.kept == 4
    assert whole.items() <= _contents(out).items() and not list(out.glob(".*"))
    other = simulate_study(drop, out, draws=2, seed=drop.seed + 1)
    assert len(flights) == 8 and other.kept == 0
    assert not set(whole.values()) & set(_contents(out).values())
