"""Flights of another program: laws of their conversion in every set's own axes and units, studies, scores, verdicts."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import other_flights
import other_records
import other_scores
import other_studies
import pytest

from bayeschute.aero.term_names import check_axial, check_transverse, is_pairwise
from bayeschute.core.vectors import Vec3
from bayeschute.records.foreign.attitudes import rate_of_attitude
from bayeschute.records.foreign.conventions import Conventions

DATA = Path(__file__).parents[3] / "shared" / "otherflights"
TEMPLATES = Path(__file__).parents[2] / "src" / "bayeschute" / "templates"
SETS = "PQRSTU"
there = pytest.mark.skipif(not DATA.is_dir(), reason=f"flights of the other program are not in {DATA}")


@pytest.fixture(scope="module")
def other():
    return SimpleNamespace(flights=other_flights, records=other_records, scores=other_scores, studies=other_studies)


@pytest.fixture(scope="module")
def flight(other):
    known = {}

    def get(name):
        if name not in known:
            known[name] = other.records.read_flight(DATA, name)
        return known[name]

    return get


@pytest.fixture(scope="module")
def written(other, tmp_path_factory):
    made = {}

    def get(letter):
        if letter not in made:
            kept, _ = other.flights.by_canopies(DATA, other.records.flights_of(DATA, letter))
            made[letter] = other.studies.write_set(DATA, kept, tmp_path_factory.mktemp("sets") / letter)
        return made[letter]

    return get


@there
@pytest.mark.parametrize("letter", SETS)
class TestConversion:
    def test_on_average_the_specific_force_is_one_g_upward(self, other, flight, letter):
        f = flight(f"{letter}_1")
        force = np.nanmean(other.records.to_ned(f.attitude, f.force), axis=0)
        np.testing.assert_allclose(force, [0.0, 0.0, -9.80665], atol=0.25)

    def test_velocity_is_the_rate_of_the_position(self, flight, letter):
        f = flight(f"{letter}_1")
        known = np.isfinite(f.position).all(axis=1) & np.isfinite(f.velocity).all(axis=1)
        t, x, v = f.time[known], f.position[known], f.velocity[known]
        moved = np.concatenate([[np.zeros(3)], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None], axis=0)])
        np.testing.assert_allclose(moved, x - x[0], atol=6.0, rtol=0.02)
        assert x[-1, 2] - x[0, 2] > 700.0 and np.ptp(x[:, 2]) > 700.0  # down is down

    def test_rates_turn_the_attitude(self, flight, letter):
        f = flight(f"{letter}_1")
        seen = rate_of_attitude(f.time, f.attitude, 0.3)
        for axis in (1, 2):  # about the third the body hardly turns
            both = np.isfinite(seen[:, axis]) & np.isfinite(f.rate[:, axis])
            assert np.corrcoef(seen[both, axis], f.rate[both, axis])[0, 1] > 0.8

    def test_attitude_has_no_jumps_and_length_one(self, flight, letter):
        q = flight(f"{letter}_1").attitude
        q = q[np.isfinite(q).all(axis=1)]
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-12)
        assert (np.sum(q[1:] * q[:-1], axis=1) > 0.9).all()

    def test_canopies_are_a_riser_above_the_attach_point(self, flight, letter):
        f = flight(f"{letter}_1")
        length = np.nanmedian(np.linalg.norm(f.risers(), axis=-1), axis=0)
        np.testing.assert_allclose(length, f.meta["line_length_unstretched_m"], rtol=0.04)
        assert np.nanmax(f.risers()[..., 2]) < 0.0

    def test_the_body_x_axis_points_up_the_risers(self, other, flight, letter):
        f = flight(f"{letter}_1")
        up = other.records.to_ned(f.attitude, np.array([1.0, 0.0, 0.0]))
        mean = f.risers().mean(axis=1)
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        assert np.nanmedian(np.sum(up * mean, axis=1)) > 0.95 and f.attach_b[0] > 0.1

    def test_wind_is_that_of_the_profile_at_the_capsule(self, flight, letter):
        f = flight(f"{letter}_1")
        for axis in (0, 1):
            profile = np.interp(-f.position[:, 2], f.profile[:, 0], f.profile[:, 1 + axis])
            np.testing.assert_allclose(f.wind[:, axis], np.where(np.isnan(f.wind[:, axis]), np.nan, profile), atol=0.15)

    def test_load_cells_carry_the_weight(self, flight, letter):
        f = flight(f"{letter}_1")
        if f.tension is None:
            pytest.skip(f"set {letter} has no load cells")
        weight = 9.80665 * f.meta["capsule_mass_kg"]
        assert np.nanmedian(f.tension.sum(axis=1)) == pytest.approx(weight, rel=0.1)

    def test_inertia_gives_every_turn_the_energy_that_the_set_s_axes_give_it(self, other, flight, letter):
        f, body = flight(f"{letter}_1"), Conventions(**other.records.LAYOUTS[letter].conventions).body()
        theirs = np.array(f.meta["capsule_inertia_kgm2_body_about_cm"])
        w = np.random.default_rng(1).standard_normal((5, 3))
        turned = w @ body.T
        energy = [np.einsum("ti,ij,tj->t", v, tensor, v) for v, tensor in ((turned, f.inertia), (w, theirs))]
        np.testing.assert_allclose(*energy, rtol=1e-12)
        np.testing.assert_array_equal(f.inertia, f.inertia.T)
        assert np.linalg.eigvalsh(f.inertia).min() > 0.0

    def test_the_vehicle_has_the_whole_inertia(self, other, flight, letter):
        from bayeschute.study.assembly import assemble
        from bayeschute.study.schema.vehicle_schema import Vehicle

        f = flight(f"{letter}_1")
        capsule = assemble.cluster(Vehicle.model_validate(other.studies.vehicle(f)))[0].capsule
        momentum = [np.asarray(capsule.angular_momentum(Vec3(*axis)).stack()) for axis in np.eye(3)]
        np.testing.assert_allclose(momentum, f.inertia, atol=1e-6 * f.inertia.max())

    def test_quantities_are_those_of_the_true_histories(self, flight, letter):
        if letter == "U":
            pytest.skip("set U has no true histories")
        f = flight(f"{letter}_2")
        with np.load(DATA / "truth" / f"{letter}_2_00.npz") as truth:
            for name, key, close in (
                ("swing_angle", "swing_angle_deg", 0.9),
                ("sea_level_descent_rate", "sea_level_descent_rate_mps", 0.1),
            ):
                at = np.interp(f.time, truth["time_s"], truth[key])
                assert np.nanmedian(np.abs(f.quantities()[name] - at)) < close


@there
@pytest.mark.parametrize("letter", SETS)
class TestStudies:
    def test_no_fault_is_found(self, written, letter):
        from bayeschute.study.load import check_study

        assert check_study(written(letter)) == []

    def test_settings_are_those_of_the_default_study(self, other, written, letter):
        ours, default = tomllib.loads(written(letter).read_text()), other.studies.default_study()
        assert {k: ours[k] for k in ("sampler", "predict", "seed")} == {
            k: default[k] for k in ("sampler", "predict", "seed")
        }
        single = letter in "ST"
        told = tomllib.loads((TEMPLATES / "cluster.toml").read_text(encoding="utf-8"))["structure"]
        assert ours["structure"]["saturate"] == told["saturate"] == "auto"
        for kind, check in (("axial", check_axial), ("transverse", check_transverse)):
            terms = ours["structure"][kind]
            assert not [term for term in terms if check(term)]
            left = [term for term in default["structure"][kind] if term not in terms]
            assert left == [t for t in default["structure"][kind] if single and is_pairwise(t)]

    def test_a_flight_to_be_predicted_is_blanked_beyond_its_opening(self, written, letter):
        from bayeschute.prediction.bands import OPENING
        from bayeschute.records.record import load_record

        study = written(letter)
        tables = tomllib.loads(study.read_text())
        predicted = [f["name"] for f in tables["flight"] if "predict" in f["roles"]]
        assert predicted
        for name in predicted:
            record = load_record(study.parent / f"{name}.nc")
            later = record["time"].values > record["time"].values[0] + OPENING + 0.2
            known = {v for v in record.data_vars if np.isfinite(record[v].values[later]).any()}
            assert known == {"density"}

    def test_windows_lie_in_the_record(self, other, written, letter):
        from bayeschute.study.load import check_study

        folder = written(letter).parent
        assert check_study(other.studies.write_window(DATA, f"{letter}_1", 45.0, folder)) == []
        assert other.studies.write_window(DATA, f"{letter}_1", 1000.0, folder) is None


@there
def test_a_flight_with_a_canopy_lost_stands_alone(other, tmp_path):
    """For the posterior of the others; all that it shows of itself is its opening."""
    kept, others = other.flights.by_canopies(DATA, other.records.flights_of(DATA, "R"))
    assert kept == ["R_1", "R_2"] and others == ["R_3"]
    alone = other.studies.flight_alone(DATA, "R_3", tmp_path)
    assert alone.vehicle.canopies.number == 2 and alone.roles == ("predict",)
    known = np.isfinite(alone.raw["capsule_position"].values).all(axis=1)
    assert known.any() and alone.raw["time"].values[known][-1] - alone.raw["time"].values[known][0] < 6.0
    assert other.flights.by_posterior(DATA, tmp_path, "R_3") is None


class TestScores:
    def test_against_naive_values(self, other):
        s, rng = other.scores, np.random.default_rng(2)
        time = np.arange(0.0, 20.0, 0.5)
        low, width = rng.normal(size=time.size), rng.uniform(0.5, 2.0, time.size)
        band = np.stack([low, low + 0.4 * width, low + width])
        truths = [s.History(np.arange(-1.0, 25.0, 0.3), rng.normal(0.5, 1.0, 87)) for _ in range(3)]
        truths[1].values[10:20] = np.nan
        wis, held, n, bias = 0.0, 0, 0, 0.0
        for t, y in ((t, y) for h in truths for t, y in zip(*h, strict=True)):
            if not 0.0 <= t <= 19.5 or np.isnan(y):
                continue
            a, m, b = (float(np.interp(t, time, row)) for row in band)
            interval = (b - a) + (2.0 / 0.1) * (max(a - y, 0.0) + max(y - b, 0.0))
            wis += (0.5 * abs(y - m) + 0.1 / 2.0 * interval) / 1.5
            held, n, bias = held + (a <= y <= b), n + 1, bias + m - y
        made = s.score(time, band, truths)
        assert (made.samples, made.held) == (n, pytest.approx(held / n))
        assert made.wis == pytest.approx(wis / n) and made.bias == pytest.approx(bias / n)
        assert made.below + made.above + made.held == pytest.approx(1.0)

    def test_a_constant_band_and_the_replicates_own_spread(self, other):
        s = other.scores
        time = np.arange(0.0, 10.0, 0.1)
        histories = [s.History(time, np.full(time.size, float(k))) for k in range(11)]
        band = s.constant(np.array([0.0, 5.0, 10.0]), time)
        assert s.score(time, band, histories).held == 1.0
        assert s.width_over_spread(time, band, histories) == pytest.approx(10.0 / 9.0)


class TestVerdicts:
    RAN = {"exit": 1, "traceback": False, "last": "Failed checks: rhat."}

    def test_a_converged_fit_may_fail_other_checks(self, other, tmp_path):
        checks = {"optimum": {"passed": True}, "rhat": {"passed": False}, "calibration": {"passed": None}}
        (tmp_path / "summary.json").write_text(json.dumps({"checks": checks, "label": "not verified"}))
        told = other.flights.verdict(tmp_path, self.RAN)
        assert told == {"converged": True, "reason": "", "label": "not verified", "failed": ["rhat"]}

    def test_a_fit_that_says_so_did_not_converge(self, other, tmp_path):
        fit = {"converged": False, "reason": "steps were refused", "tried": ["a"]}
        fit |= {"residuals": {"P_1": {"swing": {"rms": 2.0, "noise": 0.1, "samples": 9}}}}
        (tmp_path / "summary.json").write_text(json.dumps({"fit": fit}))
        told = other.flights.verdict(tmp_path, self.RAN)
        assert (told["converged"], told["reason"]) == (False, "steps were refused")
        assert told["best_found"] == {"tried": ["a"], "residuals": fit["residuals"]}
        words = other.flights.lines("P", {"windows": {"45": told | {"processor_s": 3.0}}})
        assert words == [
            "P  45 s: NOT CONVERGED, steps were refused; 3 s processor",
            "   tried: a",
            "   best P_1 found, residual rms: swing 2 (noise 0.1)",
        ]

    def test_nothing_left_behind_is_told_by_the_last_line(self, other, tmp_path):
        told = other.flights.verdict(tmp_path, {"exit": 2, "traceback": False, "last": "got no such stretch"})
        assert (told["converged"], told["reason"]) == (False, "exit 2: got no such stretch")
        assert other.flights.verdict(tmp_path, {"exit": 1, "traceback": True, "last": "X"})["reason"] == "traceback: X"

    def test_what_was_not_predicted_is_not_better_than_climatology(self, other):
        s = {"held": 0.8, "samples": 10, "true": True, "wis_over_climatology": 0.5}
        good = {"converged": True, "flights": {"P_2": {"swing_angle": s, "sea_level_descent_rate": s}}}
        bad = {"converged": False, "flights": {"Q_2": {}}}
        windows = {"45": {"converged": False, "reason": "x"}, "180": {"skipped": "short"}}
        made = other.flights.ratios({"P": {"whole": good, "windows": windows}, "Q": {"whole": bad, "windows": {}}})
        assert made == {
            "converged_share": 0.5, "windows_converged_share": 0.0, "predicted_share": 0.5,
            "pooled_swing_coverage": 0.8, "pooled_descent_coverage": 0.8, "better_than_climatology_share": 0.5,
        }  # fmt: skip


def test_a_flight_of_any_number_is_identified_and_the_others_keep_their_order(other):
    names = ["P_1", "P_2", "P_3"]
    assert other.flights.turned(names, 1) == names
    assert other.flights.turned(names, 3) == ["P_3", "P_1", "P_2"] and other.flights.turned(names, 4) == names


def test_tables_are_read_back_as_they_were(other):
    table = {
        "a": 1.5,
        "b": 'x "y"',
        "e*alpha^2": [1, 2],
        "c": {"1": 0.9, "d": {"e": True}},
        "f": [{"g": "°"}, {"h": []}],
    }
    assert tomllib.loads(other.studies.toml(table)) == table


@there
def test_the_command_prints_one_object_and_resumes(other, tmp_path, monkeypatch, capsys):
    calls = []

    def run(study, out, *options):
        calls.append((study.name, options))
        out.mkdir(parents=True)
        (out / "checks.json").write_text(json.dumps({"checks": {"optimum": {"passed": True}}}))
        return {"exit": 0, "processor_s": 1.0, "wall_s": 2.0, "traceback": False, "last": ""}

    def main(*more):
        told = ["--sets", "T", "--workdir", str(tmp_path), "--json", "--windows", "45", "900", *more]
        monkeypatch.setattr(sys, "argv", ["other_flights.py", "--data", str(DATA), *told])
        other.flights.main()
        return capsys.readouterr().out.splitlines()

    monkeypatch.setattr(other.flights, "run", run)
    said = main("--quick")
    made = json.loads(said[-1])
    assert made["ratios"]["windows_converged_share"] == 1.0 and made["ratios"]["predicted_share"] == 0.0
    assert any("900 s: the record is shorter" in line for line in said)
    assert calls == [("T_1.toml", ("--quick",)), ("T_1_45s.toml", ("--until", "check", "--quick"))]
    assert json.loads(main("--quick", "--resume", "--only-windows")[-1])["ratios"] == {"windows_converged_share": 1.0}
    assert len(calls) == 2


def test_independent_flights_are_made_once_and_told_by_kind_and_seed(other, tmp_path, monkeypatch, capsys):
    """A set that was stopped half-way is made again; what is stored says the command that makes it."""
    made, asked = [], []

    def make_set(folder, vehicle, seed):
        made.append((vehicle.canopies, seed))
        folder.mkdir(parents=True)
        if len(made) == 1:
            raise KeyboardInterrupt

    def set_results(data, letter, folder, given, name):
        asked.append((data.relative_to(tmp_path).as_posix(), letter, folder.name, name))
        return {"windows": {}}

    def main(*more):
        told = ["--independent", "one-main-7", "--workdir", str(tmp_path), "--json", *more]
        monkeypatch.setattr(sys, "argv", ["other_flights.py", *told])
        other.flights.main()
        return json.loads(capsys.readouterr().out.splitlines()[-1])

    monkeypatch.setattr(other.flights.independent_flights, "make_set", make_set)
    monkeypatch.setattr(other.flights, "set_results", set_results)
    with pytest.raises(KeyboardInterrupt):
        main()
    assert asked == [] and not (tmp_path / "one-main-7" / "data").exists()
    main("--resume")
    main("--resume")
    main()
    assert made == [(1, 7)] * 3 and asked == [("one-main-7/data", "P", "one-main-7", "one-main-7")] * 3
    for wrong in ("one-main", "three-mains-1", "one-main-x"):
        with pytest.raises(SystemExit, match=f"{wrong}: kind and seed, such as two-mains-1"):
            other.flights.independent(wrong, tmp_path, False)
    told = other.flights.made_now
    assert told("one-main-7", None)["command"] == "benchmarks/other_flights.py --independent one-main-7"
    command = "benchmarks/other_flights.py --data ../shared/otherflights --sets T --only-windows --windows 90"
    assert told("T", "90")["command"] == command
