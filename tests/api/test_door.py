"""The door: every name, the example of the whole way on a cluster, and a posterior that is asked again."""

from __future__ import annotations

import doctest
import json
import subprocess
import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import bayeschute as bc
from bayeschute.cli import app


def test_every_public_name_is_there_and_documented():
    without = [n for n in bc.__all__ if n != "__version__" and not (getattr(bc, n).__doc__ or "").strip()]
    assert without == [] and set(dir(bc)) == set(bc.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Posteriors'"):
        bc.Posteriors  # noqa: B018


def test_importing_the_package_imports_nothing_slow():
    script = "import sys, bayeschute; print(sorted({'jax', 'numpy', 'xarray', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.fixture(scope="module")
def forecast(posterior, sondes):
    return posterior.predict(sondes.flights["high"].changed(name="other"), draws=64)


def test_examples_of_the_docstrings_run(sondes, fitted, posterior, forecast, tmp_path):
    told = {
        "bc": bc,
        "folder": tmp_path,
        "study": sondes,
        "fitted": fitted,
        "posterior": posterior,
        "forecast": forecast,
        "next_flight": sondes.flights["high"],
        "np": np,
    }
    count = 0
    for name in (
        "inputs",
        "beliefs",
        "views.curve",
        "fitted",
        "forecast",
        "posterior",
        "views.rank_test",
        "run_folder",
        "verbs",
    ):
        result = doctest.testmod(import_module(f"bayeschute.api.{name}"), extraglobs=told, optionflags=doctest.ELLIPSIS)
        assert result.failed == 0
        count += result.attempted
    assert count >= 30


def test_every_noun_shows_itself(sondes, fitted, posterior, forecast):
    flight = sondes.flights[0]
    for one in (sondes, sondes.flights, flight, sondes.priors, fitted, posterior, forecast):
        assert one._repr_html_().count("<tr>") >= 2 and len(repr(one)) < 500
    assert "low" in repr(posterior) and "other" in repr(forecast) and "&lt;" not in repr(flight)


def test_a_posteriors_summary_has_units(posterior):
    told = posterior.summary()
    assert told.columns[0] == "unit" and list(told.index) == list(posterior.names)
    assert [*told["unit"]] == [posterior[name].attrs["units"] for name in posterior.names]
    assert isinstance(posterior.summary(fmt="xarray"), xr.Dataset)  # as ArviZ makes it
    (mean,), (sd,) = told["mean"], told["sd"]
    (name,) = posterior.names
    assert mean == pytest.approx(float(posterior[name].mean()), rel=5e-4) and mean == float(f"{mean:.4g}")
    assert sd == pytest.approx(float(posterior[name].std()), rel=5e-3) and sd > 0.0  # not rounded away
    assert {"eti90_lb", "eti90_ub"} <= {*told.columns} and "eti50_lb" in posterior.summary(ci_prob=0.5).columns


def test_identifiability_has_contraction_and_the_diagnosis_of_the_report(posterior):
    told = posterior.identifiability()
    (name,) = told.index
    prior = posterior.data["prior"][name].values
    assert told.columns[0] == "contraction"
    assert told.loc[name, "contraction"] == pytest.approx(1.0 - (float(posterior[name].std()) / prior.std()) ** 2)
    assert told.loc[name, "diagnosis"] == "insensitive to the prior"
    assert replace(posterior, files={}).identifiability().empty


def test_a_forecasts_summary_is_of_its_statistics(forecast):
    told = forecast.summary("maximum", 0.5)
    assert list(told.index) == list(forecast.quantities)
    for name, row in told.iterrows():
        ends = np.quantile(forecast.statistic(name, "maximum"), [0.25, 0.5, 0.75])
        np.testing.assert_allclose(row[["low", "median", "high"]].to_numpy(float), ends)
        assert row["unit"] == forecast.draws[name].attrs["units"]
    with pytest.raises(bc.InputError, match="statistic"):
        forecast.summary("worst")


def test_a_name_that_looks_like_html_is_escaped(descents):
    record = bc.read_record(
        descents.study.with_name("low.csv"), {"time": ("time_s", "s"), "altitude": ("altitude_m", "m")}
    )
    assert "<script>" not in bc.Flight(record, name="<script>")._repr_html_()


def test_a_stored_posterior_answers_as_the_one_it_was_stored_from(posterior, sondes, tmp_path):
    path = posterior.save(tmp_path / "sondes.posterior.nc")
    back = bc.Posterior.load(path)
    assert back.names == posterior.names and back.passed == posterior.passed
    np.testing.assert_array_equal(back[back.names[0]].values, posterior[posterior.names[0]].values)
    flight = sondes.flights["high"]
    want, got = (one.predict(flight, draws=64, seed=9) for one in (posterior, back))
    xr.testing.assert_identical(got.draws, want.draws)
    assert not got.draws.equals(back.predict(flight, draws=64, seed=10).draws)


def test_arviz_reads_the_stored_file(posterior, tmp_path):
    import arviz_stats

    with xr.open_datatree(posterior.save(tmp_path / "x.posterior.nc"), engine="h5netcdf") as tree:
        assert list(arviz_stats.summary(tree).index) == list(posterior.names)
        assert {"posterior", "prior", "log_likelihood", "posterior_predictive"} <= set(tree.children)


def test_a_flight_that_was_fitted_is_predicted_from_its_own_data(posterior, sondes):
    own = posterior.predict(sondes.flights["low"], draws=64)
    assert own.held_out.any() and own.held_out.mean() < 0.5  # from `identify_until` on
    assert own.check()["inside 90 %"].between(0.5, 1.0).all()
    seen, drawn = own.as_recorded("descent_rate"), own.draws["descent_rate"]
    white, correlated, _ = own.recorded_with["descent_rate"]
    assert float((seen - drawn).var()) == pytest.approx(white**2 + correlated**2, rel=0.1)
    assert own.as_recorded("sea_level_descent_rate").equals(own.draws["sea_level_descent_rate"])  # of two channels


def test_another_flight_with_the_name_of_a_fitted_one_is_refused(posterior, sondes):
    with pytest.raises(bc.InputError, match="the name of a fitted flight"):
        posterior.predict(sondes.flights["high"].changed(name="low"))


def test_another_record_in_memory_under_the_name_of_a_fitted_one_is_refused(sondes):
    """A record is no field of a flight's table, so two of them may differ in nothing else."""
    raw = sondes.flights["low"].record[["altitude", "density"]]
    flight = bc.Flight(raw, name="one", rate="1 Hz")
    fitted = bc.sample(bc.fit(flight, sondes.priors, noise=sondes.noise), draws=128, chains=2, warmup=50)
    assert fitted.predict(flight, draws=16).name == "one"
    other = bc.Flight(
        raw.assign(altitude=raw["altitude"] + np.linspace(0.0, 9.0, raw.sizes["time"])), name="one", rate="1 Hz"
    )
    with pytest.raises(bc.InputError, match="the name of a fitted flight"):
        fitted.predict(other, draws=16)


def test_of_several_bodies_one_must_be_named(finished, descents, sondes):
    posterior, other = bc.Run(finished.folder, sondes).posterior, sondes.flights["high"].changed(name="other")
    with pytest.raises(bc.InputError, match="which of them flies"):
        posterior.predict(other)
    with pytest.raises(bc.InputError, match="one of low, high"):
        posterior.predict(other, like="middle")
    fell = [posterior.predict(other, draws=64, like=name).statistic("descent_rate").mean() for name in ("low", "high")]
    low, high = (float(posterior[f"cds_over_mass[{name}]"].mean()) for name in ("low", "high"))
    assert float(fell[0] / fell[1]) == pytest.approx(np.sqrt(high / low), rel=0.02)  # at terminal speed


def test_rougher_air_widens_the_bands_of_another_flight_and_wrong_spreads_are_refused(posterior, sondes, forecast):
    flight = sondes.flights["high"].changed(name="other")
    same, rougher = (posterior.predict(flight, draws=64, disturbance_log_sd=spread) for spread in (0.0, 2.0))
    assert same.draws.equals(forecast.draws)
    width = [float((b["high"] - b["low"]).mean()) for b in (f.band("descent_rate") for f in (same, rougher))]
    assert width[1] > 1.1 * width[0]
    for wrong in (-0.1, 3.1, float("nan")):
        with pytest.raises(bc.InputError, match="disturbance_log_sd: got .*; wanted a number from 0 to 3"):
            posterior.predict(flight, disturbance_log_sd=wrong)


def test_a_posterior_has_its_level_where_its_records_are_not(posterior, tmp_path):
    """A colleague got the file alone."""
    gone = tuple(replace(flight, path=tmp_path / "gone.csv") for flight in posterior.spec.flights)
    alone = replace(posterior, spec=replace(posterior.spec, flights=gone))
    assert repr(alone.trust) == repr(posterior.trust) and alone._repr_html_()


def test_more_draws_than_the_posterior_has_are_refused(posterior, sondes):
    held = posterior.data["posterior"].sizes
    most, flight = held["chain"] * held["draw"], sondes.flights["high"].changed(name="other")
    with pytest.raises(bc.InputError, match=f"draws: got {most + 1}; wanted at most {most}, draws of the posterior"):
        posterior.predict(flight, draws=most + 1)


def test_a_probability_shows_as_many_digits_as_its_draws_tell(forecast):
    shown = repr(forecast.probability("descent_rate", at_most="100 m/s"))
    assert shown.startswith("P(met) = 1.000, 0.954 to 1.000 for the number of draws (90 %), 64 draws")
    assert repr(bc.Probability(0.5, 0.4, 0.6, 0.9, 1200, 3)).endswith(
        "(90 %), 1,200 draws, 3 of them failed to simulate and counted as not met"
    )


def test_what_follows_from_a_posterior_with_failed_checks_says_so(posterior, sondes):
    told = json.loads(posterior.files["checks.json"])
    for passed, words in ((False, "no level of trust, failed checks: rhat"), (True, "all checks passed")):
        for name, one in told["checks"].items():
            one["passed"] = passed if name == "rhat" else True
        made = replace(posterior, files={**posterior.files, "checks.json": json.dumps(told).encode()})
        forecast = made.predict(sondes.flights["high"].changed(name="other"), draws=64)
        met = forecast.probability("descent_rate", at_most="100 m/s")
        assert made.failed_checks == forecast.failed_checks == met.failed_checks == (() if passed else ("rhat",))
        assert words in repr(made) and made.trust.level.words == "not checked"
        assert ("failed checks: rhat" in made.trust.lacking) is not passed and repr(made.trust).startswith("Claim(")
        assert all(("no level of trust, failed checks: rhat" in repr(one)) is not passed for one in (forecast, met))


def test_bands_widen_with_their_level_and_probabilities_are_shares(forecast):
    narrow, wide = forecast.band("descent_rate", 0.5), forecast.band("descent_rate", 0.9)
    assert (wide["low"] <= narrow["low"]).all() and (wide["high"] >= narrow["high"]).all()
    final = forecast.statistic("descent_rate", "final").values
    limit = float(np.median(final))
    met = forecast.probability("descent_rate", statistic="final", at_most=limit)
    assert met.met == pytest.approx(np.mean(final <= limit)) and met.low < met.met < met.high and met.draws == 64
    feet = forecast.probability("descent_rate", statistic="final", at_most=f"{limit / 0.3048!r} ft/s")
    assert feet.met == pytest.approx(met.met, abs=1 / 64)


def test_draws_that_are_worth_less_leave_a_probability_more_open(forecast):
    limit = float(np.median(forecast.statistic("descent_rate", "final").values))
    fewer = replace(forecast, independent=16)
    one, other = (f.probability("descent_rate", statistic="final", at_most=limit) for f in (forecast, fewer))
    assert one.met == other.met and other.low < one.low and one.high < other.high


def test_a_run_its_files_and_its_python_say_the_same_of_a_requirement(finished, descents):
    (row, *_) = json.loads((finished.folder / "risk" / "requirements.json").read_text())
    run = bc.Run(finished.folder, bc.Study.load(descents.study))
    told = run.forecasts[row["run"]].probability(row["quantity"], statistic=row["statistic"], at_most=row["at_most"])
    assert (told.met, told.low, told.high) == (row["probability_met"], row["simulation_low"], row["simulation_high"])
    assert row["widened_by"] == 1.0


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda f: f.band("swing"), "one of descent_rate"),
        (lambda f: f.band("descent_rate", 90.0), "a probability between 0 and 1"),
        (lambda f: f.probability("descent_rate", statistic="mode", at_most=1.0), "one of final, maximum, mean"),
        (lambda f: f.probability("descent_rate"), "exactly one of the two"),
    ],
)
def test_questions_that_make_no_sense_are_refused(forecast, ask, words):
    with pytest.raises(bc.InputError, match=words):
        ask(forecast)


@pytest.mark.parametrize("content", [b"", b"no netcdf", b"\x89HDF\r\n\x1a\n" + 100 * b"\0"])
def test_what_is_no_posterior_is_refused(tmp_path, content):
    path = tmp_path / "x.nc"
    path.write_bytes(content)
    with pytest.raises(bc.InputError, match="a posterior written by"):
        bc.Posterior.load(path)
    with pytest.raises(bc.InputError, match="no such file"):
        bc.Posterior.load(tmp_path / "none.nc")


def test_a_run_opens_as_posterior_and_forecasts(finished, descents):
    run = bc.Run(finished.folder, bc.Study.load(descents.study))
    assert list(run.forecasts) == ["low", "high"] and run.summary == finished.summary
    bands = xr.open_datatree(finished.folder / "predictions.nc", engine="h5netcdf")["low"]
    np.testing.assert_allclose(
        run.forecasts["low"].band("descent_rate")["high"], bands["descent_rate"].sel(quantile=0.95), rtol=1e-6
    )
    counted = json.loads((finished.folder / "coverage.json").read_text(encoding="utf-8"))
    for name, made in run.forecasts.items():
        checked = made.check().query("reference == 'record'").set_index("quantity")
        for column, kept in (("inside 90 %", "record"), ("p", "record_p")):
            known = {q: one[kept] for q, one in counted[name].items() if one["record"] is not None}
            assert known and checked.loc[list(known), column].to_dict() == pytest.approx(known)
    assert run.posterior.names == tuple(
        map(str, xr.open_datatree(finished.folder / "posterior.nc", engine="h5netcdf")["posterior"].data_vars)
    )


def test_the_whole_way_on_a_cluster(tmp_path, monkeypatch):
    """The example of the documentation, on half a minute of a virtual drop and few candidates."""
    monkeypatch.setattr("bayeschute.study.landing_campaign.candidate_drops.FLOWN", 1)
    study = bc.Study.example()
    flight = study.flights["cdt-3-11"].changed(window=(0.0, 25.0))
    motion = bc.reconstruct(flight)
    assert motion["C_A"].dims == ("time", "canopy")
    modes = motion.modes(length=8.0)
    assert len(modes.labels) >= 3 and modes.stretches[0].start == pytest.approx(motion["time"].values[0])
    few = study.candidates.model_copy(
        update={"axial": ("1", "alpha^2"), "transverse": ("e", "e*alpha^2", "rate"), "fit": "pool"}
    )
    structure = bc.select_structure(motion, few)
    assert {"coefficient", "term", "estimate", "se"} <= set(structure.table) and structure.plot().axes
    priors = bc.Priors.from_structure(structure, inflation=10.0) | study.priors
    assert {"axial[1]", "riser_stiffness"} <= set(priors.names)
    fit = bc.fit([flight], priors, noise=study.noise)
    assert fit.converged and set(fit.parameters.index) == set(priors.names)
    posterior = bc.sample(fit, draws=400, seed=1)
    assert posterior["axial[1]"].sizes == {"chain": 4, "draw": 100}
    assert set(posterior.identifiability().index) == set(priors.names)
    back = bc.Posterior.load(posterior.save(tmp_path / "cdt-3-11.posterior.nc"))
    low, high = back.ranges["alpha"]
    assert 0.0 < low < high < 0.6 and 0.4 < back.ranges["D_prox"][0] < back.ranges["D_prox"][1] < 1.0
    curve = back.curve("C_N_rate")
    np.testing.assert_allclose(
        curve.draws, np.multiply.outer(back["transverse[rate]"].values.ravel(), np.cos(curve.grid))
    )
    assert curve.flown == (low, high) and curve.prior_band is not None and curve.plot().lines
    assert set(back.proposals()["kind"]) == {"axial", "transverse"}
    another = study.flights["cdt-3-12"].changed(window=(0.0, 20.0))
    forecast = back.predict(another, draws=64)
    lighter = back.predict(another.changed(name="lighter", capsule_mass=7000.0), draws=64)
    rate = "sea_level_descent_rate"
    assert float(lighter.statistic(rate).median()) < 0.95 * float(forecast.statistic(rate).median())
    assert forecast.check()["inside 90 %"].notna().all() and forecast.plot().axes
    assert 0.0 <= forecast.probability(rate, statistic="mean", at_most="33 ft/s").met <= 1.0
    assert callable(bc.numpyro_model(fit)) and callable(bc.numpyro_model(back))
    requirement = [{"name": "soft", "limits": [{"quantity": "vertical_speed", "at_most": "9.5 m/s"}]}]
    landings = back.land(draws=64, start={"altitude": "150 m"}, requirement=requirement, ground={"altitude": "0 m"})
    assert landings.failed == 0 and landings.judgements()[0].requirement.name == "soft"
    drops = landings.rank_drops(candidate_drops(tmp_path)).table.set_index("candidate")
    assert (drops["spread_expected"] < drops["spread_now"]).all() and (drops["information"] > 0.0).all()
    told = drops["information"]
    assert told["coarse"] < told["plain"] and told["load-cells"] > 0.9 * told["plain"]
    assert (drops["probit_sd_left"] < 1.0).all()
    landed_by_the_command(tmp_path / "cdt-3-11.posterior.nc", tmp_path)


def landed_by_the_command(stored, folder):
    """A campaign file with a climatology of two months over the sea, by `bayeschute land`."""
    rows = [f"{month},{h},{3 + month},1,1,2" for month in (6, 7, 12) for h in (0, 400)]
    (folder / "winds.csv").write_text("\n".join(["month,h,v,u,sv,su", *rows]) + "\n")
    columns = "".join(
        f'{name} = {{ column = "{column}", unit = "{unit}" }}\n'
        for name, column, unit in (
            ("altitude", "h", "m"), ("north", "v", "m/s"), ("east", "u", "m/s"), ("north_sd", "sv", "m/s"),
            ("east_sd", "su", "m/s"),
        )
    )  # fmt: skip
    (folder / "sea.toml").write_text(f"""title = "at sea"
seed = 3
[start]
altitude = "150 m"
[ground.waves]
significant_height = "2 m"
mean_period = "6 s"
[wind.climatology]
length = "1 km"
[wind.climatology.statistics]
file = "winds.csv"
month = "month"
months = [6, 7]
{columns}
[[requirement]]
name = "water"
limits = [
  {{ quantity = "normal_speed", at_most = "14 m/s" }},
  {{ quantity = "tangential_speed", at_most = "20 m/s" }},
  {{ quantity = "surface_angle", at_most = "40 deg" }},
]
""")
    out = folder / "at-sea"
    said = CliRunner().invoke(
        app, ["land", str(stored), str(folder / "sea.toml"), "--out", str(out), "--landings", "64"]
    )
    assert said.exit_code == 0, said.output
    rows = bc.Landings.load(out / "landings.nc").rows
    assert (rows["outcome"] == 0).all() and set(rows["profile"]) == {0, 1} and len(set(rows["surface_rise"])) == 64
    assert np.std(rows["surface_rise"]) == pytest.approx(np.pi / 6.0, rel=0.3)  # omega H_s / 4
    assert np.std(rows["normal_speed"] - rows["vertical_speed"]) == pytest.approx(np.pi / 6.0, rel=0.5)
    assert {"exceedance-normal_speed.csv", "landings-surface_angle.png"} <= {path.name for path in out.iterdir()}
    assert (out / "requirements.csv").read_text().splitlines()[1].startswith("water,")


def candidate_drops(folder):
    """A drop as the study records it, with load cells beside, and with all sensors three times as coarse."""
    virtual = """
duration = "12 s"
rate = "10 Hz"
altitude = "6500 ft"
swing = "12 deg"
swing_azimuth = "0 deg"
swing_rate = "0 deg/s"
flyout = "9 deg"
flyout_azimuth = "90 deg"
wind = { altitude = ["0 ft", "8000 ft"], north = ["0 ft/s", "0 ft/s"], east = ["0 ft/s", "0 ft/s"] }
"""
    tension = 'riser_tension = { white = "100 lbf", kind = "white" }'
    text = ""
    for name, noise, load, factor in (
        ("plain", "", "", 1.0), ("load-cells", f"noise = {{ {tension} }}\n", 'riser_tension = { white = "100 lbf" }', 1.0),
        ("coarse", "", "", 3.0),
    ):  # fmt: skip
        seen = f'canopy_position = {{ white = "{0.15 * factor} m" }}\ncapsule_velocity = {{ white = "{0.1 * factor} m/s" }}\n'
        seen += f'capsule_attitude = {{ white = "{0.1 * factor} deg" }}\n'
        seen += f'wind = {{ correlated = "{factor} ft/s", time_constant = "20 s" }}\n'
        sensors = f"[flight.virtual.sensors]\n{seen}{load}\n"
        text += f'[[flight]]\nname = "{name}"\n{noise}[flight.virtual]{virtual}{sensors}'
    path = folder / "candidates.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_flight_is_changed_by_what_it_is_made_by(sondes):
    flight = sondes.flights["low"]
    other = flight.changed(name="other", rate="2 Hz", capsule_mass="9 t", window=("5 s", 60.0), identify_until="65 %")
    assert (other.spec.rate, other.spec.capsule_mass, other.spec.window) == (2.0, 9000.0, (5.0, 60.0))
    assert other.vehicle == flight.vehicle and flight.changed().spec == flight.spec
    numbers = flight.changed(window=np.array([5.0, 60.0]), rate=np.float64(2.0), accept_implausible=[])
    assert (numbers.spec.window, numbers.spec.rate) == ((5.0, 60.0), 2.0) and not numbers.spec.accept_implausible
    with pytest.raises(bc.InputError, match="one of name, roles"):
        flight.changed(mass="9 t")
    with pytest.raises(bc.InputError, match="a quantity in kg") as told:
        flight.changed(capsule_mass="9 m", rate=-2.0, window=(60.0, 5.0))
    assert len(told.value.faults) == 3  # the order of the window's ends beside single values
    for values in ({"capsule_mass": -9000.0}, {"rate": np.nan}, {"window": (60.0, 5.0)}, {"roles": ("fit",)}):
        with pytest.raises(bc.InputError, match=f"flight.*{next(iter(values))}"):
            flight.changed(**values)
    with pytest.raises(bc.InputError, match="from bc.wind_profile"):
        flight.changed(wind="5 m/s")
    with pytest.raises(bc.InputError, match="Did you mean 'capsule_mass'"):
        flight.changed(capsul_mass=9000.0)
    with pytest.raises(bc.InputError, match="wanted altitudes that increase"):
        bc.wind_profile([0.0, -5.0], [1.0, 2.0], [0.0, 0.0])


def test_repairs_are_told_line_by_line(sondes):
    repairs = sondes.flights["low"].repairs
    assert len(repr(repairs).splitlines()) == len(repairs) > 0 and repairs[0].kind in repr(repairs)
    assert repr(type(repairs)()) == "nothing was changed"


def test_a_run_that_its_own_data_contradict_has_no_level(tmp_path, sondes):
    for claim, level in (
        ({"level": "not checked", "contradicted": ["x"]}, "contradicted by its own data"),
        ({"level": "self-consistent", "contradicted": []}, "self-consistent"),
    ):
        (tmp_path / "summary.json").write_text(json.dumps({"claim": claim}), encoding="utf-8")
        assert bc.Run(tmp_path, sondes).level == level


def test_a_run_is_opened_by_its_folder_alone(finished):
    run = bc.Run(str(finished.folder))
    assert [flight.name for flight in run.study.flights] == ["low", "high"]
    assert run.posterior.names == ("cds_over_mass[low]", "cds_over_mass[high]", *run.posterior.names[2:])
    shown = run._repr_html_()
    missed = [name for name, one in run.summary["checks"].items() if one["passed"] is False]
    assert ": finished" in shown and run.level in shown and all(name in shown for name in missed)
    for one in run.summary["requirements"]:
        assert f"<td>{one['name']} on {one['run']}</td><td>P(met) = {one['probability_met']:.3f}</td>" in shown


def test_keys_are_completed(finished):
    run = bc.Run(str(finished.folder))
    for keyed in (run.study.flights, run.forecasts, run.posterior):
        names = keyed._ipython_key_completions_()
        assert names and all(keyed[name] is not None for name in names)


def test_records_of_names_with_dots_are_kept(descents, tmp_path):
    text = descents.study.read_text(encoding="utf-8").replace('name = "low"', 'name = "drop.1"')
    path = descents.study.with_name("dotted.toml")
    path.write_text(text, encoding="utf-8")
    flight = bc.Study.load(path).flights["drop.1"]
    posterior = bc.sample(bc.fit(flight), draws=128, chains=2, warmup=50)
    assert "flights/drop.1.nc" in posterior.files and posterior.predict(flight, draws=16).name == "drop.1"


def test_virtual_flights_are_simulated_by_their_study(tmp_path):
    study = bc.Study.example()
    virtual = study.spec.flights[0].virtual.model_copy(update={"duration": 5.0})
    short = bc.Study(replace(study.spec, flights=(replace(study.spec.flights[0], virtual=virtual),)))
    drops = bc.simulate_study(short, tmp_path, seed=2)
    assert drops.failed == {} and sorted(one.name for one in drops.files) == ["cdt-3-11.nc", "cdt-3-11.truth.nc"]


def test_priors_are_given_as_in_a_study():
    """The same as the study's own table, whatever the units; faults by the name of the parameter."""
    study = bc.Study.example()
    tables = {
        "riser_stiffness": {"median": "15000 lbf/ft", "log_sd": 0.2},
        "riser_length": {"mean": "71.3232 m", "sd": "1 ft"},
    }
    made = bc.Priors.given(**tables, source="drawing")
    for one in made.parameters:
        other = next(p for p in study.priors.parameters if p.name == one.name)
        assert (one.centre, one.scale) == pytest.approx((other.centre, other.scale)) and one.source == "drawing"
        assert one.logarithmic == other.logarithmic and one.unit == other.unit
    with pytest.raises(bc.InputError) as caught:
        bc.Priors.given(riser_length={"mean": "234 kg", "sd": "1 ft"}, risers={"mean": 1.0, "sd": 2.0})
    assert len(caught.value.faults) == 2 and "[riser_length] mean" in str(caught.value)


def test_sizes_of_the_sampler_out_of_range_are_a_fault(fitted):
    with pytest.raises(bc.InputError, match="draws: got 8; wanted a whole number from 50"):
        bc.sample(fitted, draws=16, chains=2)


def test_noise_is_told_with_its_units():
    said = repr(bc.Study.example().noise)
    assert "capsule_attitude  white 0.001745 rad, correlated 0.003491 rad, time_constant 2 s" in said
    assert "breathing         sd 0.02 1, frequency 0.25 Hz, damping_ratio 0.1 1" in said
