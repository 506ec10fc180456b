"""Formulations by choice: what the study file may ask for, what the fit is given, and whole runs that say what they are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.likelihood.disturbances import Latent
from bayeschute.study.assembly import assemble
from bayeschute.study.formulation import label, noise_medians, notes, unused_of
from bayeschute.study.load import load_study
from bayeschute.study.run.stages import run_study
from bayeschute.study.schema.belief_schema import ChannelNoise

MODELS = ("ar1", "ar1+white", "white", "sandwich")


def asking(descents, folder: Path, model: str) -> Path:
    """The study of one of the made-up sondes with a noise model and no latent tables."""
    text = descents.study.read_text(encoding="utf-8")
    first, second, rest = text.split("[[flight]]")
    rest = rest[rest.index("[priors.given]") :]
    text = f"{first}[[flight]]{second}{rest}".replace("[noise]\n", f'[noise]\nmodel = "{model}"\n')
    wind = text.index("[noise.wind]")
    text = text[:wind] + text[text.index("[sampler]") :]
    (folder / "low.csv").write_bytes((descents.study.parent / "low.csv").read_bytes())
    path = folder / "one.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_default_is_latent(cluster: Path):
    study = load_study(cluster)
    assert study.noise.model == "latent" and study.noise.has_latent()
    assert label("latent") == "" and notes(study.noise) == [] and assemble.latent(study, 2).least == 0


@pytest.mark.parametrize("model", MODELS)
def test_other_models_have_no_latent_disturbances(cluster: Path, spoil, model: str):
    study = load_study(spoil(cluster, r"^\[noise\].*", f'[noise]\nmodel = "{model}"'))
    made = assemble.latent(study, 2)
    assert made == Latent((), (), 3) and made.rows == 3 and made.size == 0
    assert assemble.hyper(study).disturbance_parameters == () and assemble.noise_parameter_names(study) == ()
    assert label(model) and any("not used" in line for line in notes(study.noise))


@pytest.mark.parametrize("model", MODELS)
def test_a_model_that_knows_one_part_of_the_noise_gives_it_the_variance_of_both(cluster: Path, model: str):
    channels = list(load_study(cluster).noise.channels().values())
    made, whole = noise_medians(channels, model), noise_medians(channels, "latent")
    np.testing.assert_allclose(np.hypot(made.white, made.correlated), np.hypot(whole.white, whole.correlated))
    assert (made.white < 1e-5).all() == (model == "ar1")
    assert (made.correlated < 1e-5).all() == (model in ("white", "sandwich"))


def test_a_latent_fit_needs_a_wind(descents, tmp_path: Path):
    with pytest.raises(InputError, match=r"\[noise\] wind.*noise model 'latent'"):
        load_study(asking(descents, tmp_path, "latent"))


def test_an_unknown_model_is_refused(descents, tmp_path: Path):
    with pytest.raises(InputError, match="'latent', 'ar1', 'ar1\\+white', 'white' or 'sandwich'|model"):
        load_study(asking(descents, tmp_path, "pink"))


@pytest.fixture(scope="module")
def sandwich(descents, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("sandwich")
    return folder / "run", run_study(asking(descents, folder, "sandwich"), folder / "run")


def test_a_sandwich_runs_to_the_end_and_says_what_it_is(sandwich, descents):
    folder, summary = sandwich
    assert summary["noise_model"] == summary["sampling"]["sampler"] == "sandwich"
    assert "for comparison: classical output error" in summary["label"]
    noise = summary["noise"]["descent_rate"]
    assert noise["correlated"] is None and noise["time_constant"] is None and 0.1 < noise["white"] < 1.0
    (row,), found = summary["output_error"], summary["parameters"]["cds_over_mass"]
    assert row["parameter"] == "cds_over_mass" and row["unit"] == "m^2/kg"
    assert row["corrected_sd"] > 1.3 * row["raw_sd"]
    assert found["sd"] == pytest.approx(row["corrected_sd"], rel=0.2)
    assert abs(row["estimate"] - descents.truth["low"]) < 4.0 * row["corrected_sd"]
    told = summary["identifiability"]["low"]
    assert set(told["parameters"]["cds_over_mass"]) == {"contraction", "shift"} and told["noise"] == {}
    assert told["directions"][0]["contraction"] == pytest.approx(found["contraction"], abs=0.03)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Corrected s.e." in page and "classical output error" in page
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        assert {"posterior", "prior", "log_likelihood", "posterior_predictive"} <= set(tree.children)
    with xr.open_datatree(folder / "predictions.nc", engine="h5netcdf") as tree:
        assert np.isfinite(tree["low"]["descent_rate"].values).all()


def test_white_noise_draws_from_the_raw_bound(descents, tmp_path: Path, sandwich):
    run_study(asking(descents, tmp_path, "white"), tmp_path / "run", until="check")
    told = json.loads((tmp_path / "run" / "identifiability.json").read_text(encoding="utf-8"))["low"]
    assert set(told["noise"]) == {"descent_rate, white noise"}
    assert told["parameters"]["cds_over_mass"]["noise_partner"] == "descent_rate, white noise"
    (row,) = json.loads((tmp_path / "run" / "fit" / "output_error.json").read_text(encoding="utf-8"))
    assert row == pytest.approx(sandwich[1]["output_error"][0])
    with xr.open_datatree(tmp_path / "run" / "posterior.nc", engine="h5netcdf") as tree:
        assert float(tree["posterior"]["cds_over_mass"].std()) == pytest.approx(row["raw_sd"], rel=0.25)
        assert "acceptance_rate" in tree["sample_stats"]
    assert label("white").startswith("for teaching only")


def test_ar1_fits_without_latent_disturbances_and_leaves_no_table_of_output_error(descents, tmp_path: Path, sandwich):
    run_study(asking(descents, tmp_path, "ar1"), tmp_path / "run", until="check")
    told = json.loads((tmp_path / "run" / "identifiability.json").read_text(encoding="utf-8"))["low"]
    assert set(told["noise"]) == {"descent_rate, correlated noise", "descent_rate, time constant"}
    facts = json.loads((tmp_path / "run" / "fit" / "facts.json").read_text(encoding="utf-8"))
    assert facts["failed"] == 0 and not (tmp_path / "run" / "fit" / "output_error.json").exists()
    with xr.open_datatree(tmp_path / "run" / "posterior.nc", engine="h5netcdf") as tree:
        draws = tree["posterior"]["cds_over_mass"].values
        assert float(tree["constant_data"]["descent_rate"].sel(noise_parameter="white")) < 1e-3
        assert set(tree["constant_data"].ds.data_vars) == {"descent_rate"}
    # its interval is no longer that of white noise
    assert draws.std() > 1.3 * sandwich[1]["output_error"][0]["raw_sd"]


@pytest.mark.parametrize(
    ("stated", "model", "without"),
    [
        ({"white": 1.0, "correlated": 2.0, "time_constant": "3 s"}, "latent", ()),
        ({"white": 1.0, "kind": "white"}, "latent", ("correlated", "time_constant")),
        ({"correlated": 2.0, "time_constant": "3 s", "kind": "ar1"}, "latent", ("white",)),
        ({"white": 1.0, "kind": "white"}, "ar1", ("white",)),  # there its size is that of the correlated part
    ],
)
def test_parts_of_a_channel_s_noise_that_it_has_not_are_known(stated, model, without):
    assert unused_of(ChannelNoise[float](**stated), model) == without
