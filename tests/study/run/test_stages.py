"""Stages of a run: what is kept, what is done again, what is refused, and that a stop costs nothing but time."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.records.record import load_record, repairs
from bayeschute.study import stage_keys
from bayeschute.study.assembly import assemble
from bayeschute.study.evidence.identity import configuration
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.load import Study, load_study
from bayeschute.study.run import stage_list, stages
from bayeschute.study.run.simulate import simulate_study
from bayeschute.study.run.stages import STAGES, run_study
from bayeschute.virtual.drop import fly

Told = list[tuple[str, float, str]]
KEPT = "kept from an earlier run"


def _markers(folder: Path) -> dict[str, tuple[str, int]]:
    """Hash and time of every stage that counts as finished."""
    return {p.name: (p.read_text(encoding="utf-8"), p.stat().st_mtime_ns) for p in (folder / ".stages").iterdir()}


def _listen() -> tuple[Told, Callable[[str, float, str], None]]:
    told: Told = []
    return told, lambda stage, share, words: told.append((stage, share, words))


def _posterior(folder: Path) -> xr.Dataset:
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        return tree["posterior"].to_dataset().load()


@pytest.fixture
def sondes(descents, tmp_path: Path) -> Path:
    """The study in a folder of the test's own."""
    return Path(shutil.copytree(descents.study.parent, tmp_path / "study")) / descents.study.name


@pytest.fixture
def begun(sondes: Path, tmp_path: Path) -> Path:
    """A run that has come as far as the priors."""
    run_study(sondes, tmp_path / "run", until="priors")
    return tmp_path / "run"


def test_stages_are_told_in_order(finished):
    done = [stage for stage, share, _ in finished.told if share == 1.0]
    assert tuple(dict.fromkeys(done)) == STAGES
    assert all(0.0 <= share <= 1.0 for _, share, _ in finished.told)


def test_until_is_the_last_stage(begun: Path):
    assert set(_markers(begun)) == {"ingest", "structure", "priors"}
    assert (begun / "priors.json").is_file()
    assert not (begun / "posterior.nc").exists()


def test_an_unknown_stage_is_refused(sondes: Path, tmp_path: Path):
    with pytest.raises(InputError, match="--until: got 'tea'; wanted one of ingest, "):
        run_study(sondes, tmp_path / "run", until="tea")
    assert not (tmp_path / "run").exists()


def test_resume_keeps_finished_stages(finished, descents, tmp_path: Path):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    before = _markers(folder)
    told, listen = _listen()
    assert run_study(descents.study, folder, resume=True, progress=listen) == finished.summary
    assert _markers(folder) == before
    assert told == [(stage, 1.0, KEPT) for stage in STAGES]


def test_resume_writes_the_report_anew_where_replicates_were_stored_since(finished, descents, tmp_path: Path):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    held = {
        "hash": configuration(load_study(descents.study)), "numerics": numerics(), "disturbance": "none", "replicates": 3,
        "failed": {},
        "coverage": {"cds_over_mass[low]": 0.9}, "standard_error": {"cds_over_mass[low]": 0.1},
        "parameters": {"cds_over_mass[low]": {}}, "bands": {},
    }  # fmt: skip
    (folder / "calibration").mkdir()
    (folder / "calibration/latent.none.json").write_text(json.dumps(held), encoding="utf-8")
    told, listen = _listen()
    summary = run_study(descents.study, folder, resume=True, progress=listen)
    kept = [stage for stage, _, words in told if words == KEPT]
    assert kept == list(STAGES[:-1])
    assert "3 replicates, 0 failed: at least 100" in summary["label"] and "3 repl" not in finished.summary["label"]


def test_resume_makes_a_result_again_that_was_removed(finished, descents, tmp_path: Path):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    for name, kept in (("report.html", STAGES[:-1]), ("checks.json", STAGES[: STAGES.index("check")])):
        before = (folder / "posterior.nc").read_bytes()
        (folder / name).unlink()
        told, listen = _listen()
        summary = run_study(descents.study, folder, resume=True, progress=listen)
        assert (folder / name).is_file() and (folder / "report.html").is_file()
        assert [stage for stage, _, words in told if words == KEPT][: len(kept)] == list(kept)
        assert (folder / "posterior.nc").read_bytes() == before
        assert summary["parameters"] == finished.summary["parameters"]


def test_resume_goes_on_where_a_stage_is_not_marked(begun: Path, sondes: Path):
    before = _markers(begun)
    (begun / ".stages" / "priors").unlink()
    told, listen = _listen()
    run_study(sondes, begun, until="priors", resume=True, progress=listen)
    assert [words for _, share, words in told if share == 1.0] == [KEPT, KEPT, "1 parameters"]
    after = _markers(begun)
    assert after["ingest"] == before["ingest"]
    assert after["priors"][0] == before["priors"][0] and after["priors"][1] > before["priors"][1]


def test_an_earlier_run_is_not_overwritten_unless_asked(begun: Path, sondes: Path):
    before = _markers(begun)
    with pytest.raises(InputError, match="an earlier run; wanted a new folder, --resume or --force"):
        run_study(sondes, begun, until="priors")
    with pytest.raises(InputError, match="--force: got --resume together with it"):
        run_study(sondes, begun, until="priors", resume=True, force=True)
    assert _markers(begun) == before


def test_force_begins_anew_and_leaves_what_no_run_wrote(finished, descents, tmp_path: Path):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    assert {path.name for path in folder.iterdir()} <= {".stages", "inputs", *stages.RESULTS}
    (folder / "calibration").mkdir()
    (folder / "calibration/rows.json").write_text("{}", encoding="utf-8")
    told, listen = _listen()
    assert run_study(descents.study, folder, until="ingest", force=True, progress=listen) == {}
    assert KEPT not in [words for _, _, words in told]
    left = {".stages", "calibration", "flights", "inputs", "study.toml", "log.txt"}
    assert {path.name for path in folder.iterdir()} == left and (folder / "calibration/rows.json").exists()
    assert "made-up sondes" in (folder / "log.txt").read_text(encoding="utf-8").splitlines()[0]


@pytest.mark.parametrize(
    ("change", "kept"),
    [
        ("prior", ["ingest", "structure"]),
        ("record", ["structure", "priors"]),  # a descent has no structure, its priors are given
        ("seed", ["structure", "priors"]),
        ("quick", []),
        ("program", []),
    ],
)
def test_resume_keeps_no_stage_that_reads_what_has_changed(
    begun: Path, sondes: Path, spoil, change: str, kept: list[str], monkeypatch
):
    options = {"seed": {"seed": 5}, "quick": {"quick": True}}.get(change, {})
    if change == "prior":
        spoil(sondes, "log_sd = 0.5", "log_sd = 0.4")
    elif change == "record":
        spoil(sondes.parent / "low.csv", r"^1,.*", "1,2988.0")
    elif change == "program":
        monkeypatch.setattr(stage_keys, "ARTEFACT_VERSION", stage_keys.ARTEFACT_VERSION + 1)
    before = _markers(begun)
    told, listen = _listen()
    run_study(sondes, begun, until="priors", resume=True, progress=listen, **options)
    assert [stage for stage, _, words in told if words == KEPT] == kept
    assert {stage for stage, marker in _markers(begun).items() if marker == before[stage]} == {*kept}


def test_comments_and_units_of_a_study_are_no_change(begun: Path, sondes: Path, spoil):
    spoil(sondes, '"0.5 m/s"', '"50 cm/s" # the same')
    told, listen = _listen()
    run_study(sondes, begun, until="priors", resume=True, progress=listen)
    assert told == [(stage, 1.0, KEPT) for stage in STAGES[:3]]


def test_results_of_other_inputs_are_not_left_beside_new_ones(finished, descents, tmp_path: Path):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    assert run_study(descents.study, folder, until="ingest", resume=True, seed=5) == {}
    assert set(_markers(folder)) == {"ingest", "structure", "priors"}  # the latter two read no seed
    assert not (folder / "summary.json").exists() and not (folder / "report.html").exists()


FURTHER = """
[[flight]]
name = "further"
file = "high.csv"
roles = ["predict"]
rate = "1 Hz"
[priors.given]"""
CHANGES = {
    "title": ('"Two made-up sondes"', '"Two others"', "report"),
    "requirement": ('"14 m/s"', '"13 m/s"', "risk report"),
    "draws": (r"draws = 100\n\[\[req", "draws = 150\n[[req", "predict risk report"),
    "flight": (r"^\[priors\.given\]", FURTHER.strip(), "ingest predict risk report"),
    "prior": ("log_sd = 0.5", "log_sd = 0.4", "priors fit check predict risk report"),
    "noise": ('"0.5 m/s"', '"0.4 m/s"', "fit check predict risk report"),
    "sampler": ("warmup = 50", "warmup = 60", "fit check predict risk report"),
    "record": ('rate = "1 Hz"', 'rate = "2 Hz"', "ingest fit check predict risk report"),
    "held out": ('"65 %"', '"70 %"', "fit check predict risk report"),
}


def _stages_that_do_nothing(monkeypatch):
    """But leave the file without which a stage is not done."""

    def did(job, stage):
        if stage in stages._ALWAYS:
            (job.out / stages._ALWAYS[stage]).touch()
        return f"{stage} done"

    for stage in STAGES:
        monkeypatch.setattr(stage_list, stage, lambda job, stage=stage: did(job, stage))


@pytest.mark.parametrize("change", sorted(CHANGES))
def test_a_stage_is_done_again_where_it_reads_what_has_changed(
    sondes: Path, tmp_path: Path, spoil, monkeypatch, change: str
):
    _stages_that_do_nothing(monkeypatch)
    run_study(sondes, tmp_path / "run")
    old, new, again = CHANGES[change]
    spoil(sondes, old, new)
    told, listen = _listen()
    run_study(sondes, tmp_path / "run", resume=True, progress=listen)
    assert [stage for stage, _, words in told if words == f"{stage} done"] == again.split()
    assert [stage for stage, _, words in told if words == KEPT] == [s for s in STAGES if s not in again.split()]


def test_a_stage_stopped_after_a_change_costs_nothing_else(sondes: Path, tmp_path: Path, spoil, monkeypatch):
    _stages_that_do_nothing(monkeypatch)
    run_study(sondes, tmp_path / "run")

    def stopped(job: object) -> str:
        raise KeyboardInterrupt

    spoil(sondes, *CHANGES["flight"][:2])
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(stage_list, "ingest", stopped)
        run_study(sondes, tmp_path / "run", resume=True)
    assert set(_markers(tmp_path / "run")) == {"structure", "priors", "fit", "check"}
    told, listen = _listen()
    run_study(sondes, tmp_path / "run", resume=True, progress=listen)
    assert [s for s, _, words in told if words == f"{s} done"] == ["ingest", "predict", "risk", "report"]


def test_the_structure_of_a_cluster_is_tested_on_every_flight_and_found_on_its_own(cluster: Path, spoil):
    study = load_study(cluster)
    first, second = study.flights
    lighter = replace(study, flights=(first, replace(second, capsule_mass=9000.0)))
    longer = replace(study, flights=(replace(first, skip_first=1.0), second))
    keys = [stage_keys.stage_keys(one, False, {}) for one in (study, lighter, longer)]
    assert [s for s in STAGES if keys[0][s] == keys[1][s]] == ["priors", "fit", "check"]
    assert not {*keys[0].items()} & {*keys[2].items()}
    without = replace(study, flights=study.flights[:1])
    assert stage_keys.stage_keys(without, False, {})["fit"] == keys[0]["fit"]
    assert stage_keys.stage_keys(study, True, {})["fit"] != keys[0]["fit"]


def test_a_further_flight_to_predict_changes_no_number_of_the_others(finished, sondes: Path, tmp_path: Path, spoil):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    # In front of the others, so that their places change.
    spoil(sondes, r"^\[\[flight\]\]", FURTHER.rpartition("\n")[0].strip() + "\n[[flight]]")
    told, listen = _listen()
    summary = run_study(sondes, folder, resume=True, progress=listen)
    assert [stage for stage, _, words in told if words == KEPT] == ["structure", "priors", "fit", "check"]
    assert summary["parameters"] == finished.summary["parameters"]
    assert set(summary["coverage"]) == {"further", "low", "high"}
    with (
        xr.open_datatree(folder / "predictions.nc", engine="h5netcdf") as made,
        xr.open_datatree(finished.folder / "predictions.nc", engine="h5netcdf") as before,
    ):
        for name in ("low", "high"):
            xr.testing.assert_identical(made[name].to_dataset(), before[name].to_dataset())
    with np.load(folder / "fit/statistics.npz") as a, np.load(finished.folder / "fit/statistics.npz") as b:
        assert set(b.files) < set(a.files) and all(a[key].tobytes() == b[key].tobytes() for key in b.files)


def test_a_run_that_was_stopped_gives_the_same_draws_bit_for_bit(finished, begun: Path, sondes: Path):
    def stop(stage: str, share: float, words: str) -> None:
        if stage == "fit" and share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(sondes, begun, resume=True, progress=stop)
    assert "fit" not in _markers(begun)
    told, listen = _listen()
    run_study(sondes, begun, until="fit", resume=True, progress=listen)
    assert ("priors", 1.0, KEPT) in told
    xr.testing.assert_equal(_posterior(begun), _posterior(finished.folder))
    for name in ("low", "high"):
        with np.load(begun / "fit" / f"{name}.npz") as a, np.load(finished.folder / "fit" / f"{name}.npz") as b:
            assert a["xi"].tobytes() == b["xi"].tobytes()


def test_a_folder_with_other_files_is_refused_and_left_alone(sondes: Path, tmp_path: Path):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "cat.jpg").write_text("meow", encoding="utf-8")
    with pytest.raises(InputError, match="a folder with other files"):
        run_study(sondes, folder)
    assert [path.name for path in folder.iterdir()] == ["cat.jpg"]


def test_a_faulty_study_leaves_no_folder(sondes: Path, tmp_path: Path, spoil):
    with pytest.raises(InputError, match="seed"):
        run_study(spoil(sondes, "^seed = 4", "seed = 'x'"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.fixture
def drop(cluster: Path, spoil) -> Path:
    """A virtual drop of ten seconds."""
    for _ in range(2):
        spoil(cluster, '^duration = "90 s"', 'duration = "10 s"')
    return cluster


def test_simulate_writes_record_and_truth(drop: Path, tmp_path: Path):
    drops = simulate_study(load_study(drop), tmp_path / "f")
    written = drops.files
    assert drops.outcomes == {"ok": 2} and drops.failed == {} and 1e-9 < drops.step_error[0] < 1e-3
    names = ["cdt-3-11.nc", "cdt-3-11.truth.nc", "cdt-3-12.nc", "cdt-3-12.truth.nc"]
    assert [path.name for path in written] == names
    assert sorted(path.name for path in (tmp_path / "f").iterdir()) == names
    record, truth = load_record(written[0]), xr.load_dataset(written[1], engine="h5netcdf")
    assert record.sizes["time"] == truth.sizes["time"] == 101
    for told in (record.attrs, truth.attrs):
        assert told["outcome"] == "ok" and 1e-9 < told["step_error_position_m"] < 1e-3
    error = (record["capsule_velocity"] - truth["capsule_velocity"]).values
    assert 0.03 < float(np.std(error)) < 0.5  # sensor errors of some 0.13 m/s
    assert not np.isnan(truth["swing_angle"]).any()
    assert float(np.rad2deg(truth["swing_angle"][0])) == pytest.approx(17.0, abs=0.5)


def test_simulate_is_set_by_its_seed(drop: Path, tmp_path: Path):
    study = load_study(drop)
    runs = [simulate_study(study, tmp_path / name, seed=seed).files for name, seed in (("a", 5), ("b", 5), ("c", 6))]
    a, b, c = ([xr.load_dataset(path, engine="h5netcdf") for path in paths] for paths in runs)
    for one, two in zip(a, b, strict=True):
        xr.testing.assert_identical(one, two)
    assert all(not one["wind"].equals(two["wind"]) for one, two in zip(a, c, strict=True))


def test_draws_are_drops_of_their_own_and_the_first_is_the_one_drawn_alone(drop: Path, tmp_path: Path):
    study = load_study(drop)
    told, listen = _listen()
    several = simulate_study(study, tmp_path / "a", draws=2, progress=listen).files
    alone = simulate_study(study, tmp_path / "b").files
    assert [path.name for path in several[:3]] == ["cdt-3-11.00000.nc", "cdt-3-11.00000.truth.nc", "cdt-3-11.00001.nc"]
    first, second = (load_record(path) for path in (several[0], several[2]))
    xr.testing.assert_equal(first, load_record(alone[0]))
    assert not first["capsule_velocity"].equals(second["capsule_velocity"])
    assert [share for _, share, _ in told] == [0.25, 0.5, 0.75, 1.0]


def test_velocity_biases_are_removed_where_asked(drop: Path, tmp_path: Path, spoil, monkeypatch):
    import bayeschute.study.run.stage_data as work

    spoil(drop, "^roles = ", "remove_velocity_bias = true\nroles = ")
    honest = work.flown

    def biased(*given: object) -> tuple[xr.Dataset, xr.Dataset]:
        record, truth = honest(*given)
        record["capsule_velocity"] = record["capsule_velocity"] + np.array([0.0, 2.0, 0.0])
        record["capsule_velocity"].attrs["units"] = "m/s"
        return record, truth

    monkeypatch.setattr(work, "flown", biased)
    run_study(drop, tmp_path / "run", until="ingest")
    first, second = (load_record(tmp_path / f"run/flights/{name}.nc") for name in ("cdt-3-11", "cdt-3-12"))
    (note,) = [r for r in repairs(first) if r.kind == "bias"]
    assert note.variable == "capsule_velocity" and "east +" in note.detail
    assert not [r for r in repairs(second) if r.kind == "bias"]
    truth = xr.load_dataset(tmp_path / "run/flights/cdt-3-11.truth.nc", engine="h5netcdf")
    left = (first["capsule_velocity"] - truth["capsule_velocity"]).mean("time").values
    assert abs(left[1]) < 0.3


def test_drops_that_fail_are_counted_and_told(drop: Path, tmp_path: Path, monkeypatch):
    study, flights = load_study(drop), []
    whole = fly(*_first(study), 1)

    def fails_at_times(*given: object) -> object:
        flights.append(given)
        if len(flights) == 2:
            raise FloatingPointError("the virtual drop left the finite numbers at 3.2 s")
        told = {"outcome": "steps too long", "failed_at_s": 4.0} if len(flights) == 3 else {}
        return tuple(part.assign_attrs(told) for part in whole)

    monkeypatch.setattr("bayeschute.study.run.stage_data.fly", fails_at_times)
    drops = simulate_study(study, tmp_path / "f", draws=2)
    assert drops.outcomes == {"ok": 2, "diverged": 1, "steps too long": 1} and len(drops.files) == 6
    assert drops.failed == {
        "cdt-3-11.00001": "the virtual drop left the finite numbers at 3.2 s",
        "cdt-3-12.00000": "steps too long at 4.0 s",
    }
    doubtful = load_record(tmp_path / "f" / "cdt-3-12.00000.nc")
    assert [(r.kind, r.start, r.count) for r in repairs(doubtful)] == [("simulation", 4.0, 61)]

    def fails(*given: object) -> object:
        raise FloatingPointError("the virtual drop left the finite numbers at 3.2 s")

    monkeypatch.setattr("bayeschute.study.run.stage_data.fly", fails)
    with pytest.raises(InputError, match="left the finite numbers") as caught:
        simulate_study(study, tmp_path / "g")
    assert len(caught.value.faults) == 2


def _first(study: Study) -> tuple[object, object, object]:
    """Drop, cluster and structure of the first flight of a study."""
    model, structure = assemble.cluster(study.vehicle)
    return assemble.drop(study.flights[0].virtual), model, structure


def test_simulate_needs_a_virtual_flight(descents, tmp_path: Path):
    with pytest.raises(InputError, match="no virtual flight"):
        simulate_study(load_study(descents.study), tmp_path / "f")
    assert not (tmp_path / "f").exists()
