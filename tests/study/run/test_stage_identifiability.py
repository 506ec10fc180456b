"""Identifiability in the stage `check`: its file, the summary and the report agree."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import arviz_stats
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from bayeschute.posterior.marginal import log_density
from bayeschute.posterior.score_dispersion import dispersion, parts_of
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import groups, load_fit
from bayeschute.study.job import Job
from bayeschute.study.load import load_study
from bayeschute.study.run import stage_identifiability, stage_list
from bayeschute.study.run.stage_identifiability import noise_labels, of_fit


@pytest.fixture(scope="module")
def job(finished, descents) -> Job:
    """The finished run, as a stage sees it."""
    return Job(load_study(descents.study), finished.folder, False, "", lambda *_: None)


@pytest.fixture(scope="module")
def told(finished) -> dict:
    return json.loads((finished.folder / "identifiability.json").read_text(encoding="utf-8"))


def test_every_fit_has_an_entry_and_the_summary_has_the_same(told, finished):
    assert set(told) == {"low", "high"}
    assert finished.summary["identifiability"] == told
    for name, fit in told.items():
        (parameter,) = fit["parameters"]
        assert parameter == f"cds_over_mass[{name}]"
        (direction,) = fit["directions"]
        assert direction["weights"] == {parameter: 1.0} and direction["words"] == f"1.00 {parameter}"


def test_numbers_agree_with_the_draws(told, finished, job):
    for group in groups(job):
        stored, (prior,) = load_fit(job, group), group.priors
        facts = told[group.name]["parameters"][prior.name]
        assert facts["shift"] == pytest.approx((stored.held.mean() - prior.centre) / prior.scale)
        (direction,) = told[group.name]["directions"]
        assert direction["contraction"] == pytest.approx(1.0 - (stored.held.std() / prior.scale) ** 2, abs=0.01)
        misfit = np.exp(dispersion(*parts_of(stored.marginal)).widening[0, 0])  # widens too, but is none of the noise's
        added = 1.0 - misfit * np.var(stored.held) / np.var(stored.theta)
        assert facts["noise_share"] == pytest.approx(added, abs=0.15)  # 200 draws
        assert facts["noise_correlation"] ** 2 - 1e-9 <= facts["noise_share"] < 1.0


def test_noise_parameters_are_named_and_told_no_worse_than_by_their_prior(told, job):
    wanted = [f"descent_rate, {part}" for part in ("white noise", "correlated noise", "time constant")]
    wanted += ["wind, vertical, sd", "wind, vertical, time constant"]
    labels, used = noise_labels(job)
    assert labels == wanted and used.all()
    for fit in told.values():
        assert list(fit["noise"]) == wanted == fit["confounding"]["noise"]
        assert all(-1e-9 <= share < 1.0 for share in fit["noise"].values())
        (row,) = fit["confounding"]["correlation"].values()
        (facts,) = fit["parameters"].values()
        assert max(np.abs(row)) == pytest.approx(abs(facts["noise_correlation"]))


def test_a_prior_that_is_felt_gets_a_likelihood_interval(finished, descents, tmp_path: Path, monkeypatch):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    study = load_study(descents.study)
    job = Job(study, folder, False, "", lambda *_: None)
    (group, *_), made = groups(job), {}
    stored = load_fit(job, group)
    for bound in (0.0, np.inf):
        monkeypatch.setattr(stage_identifiability, "SENSITIVE", bound)
        made[bound] = of_fit(job, group, stored).parameters["cds_over_mass[low]"]
    ends = made[0.0].likelihood_interval
    assert ends.level == 0.9 and ends.unit == "m^2/kg"
    low, high = np.quantile(np.exp(stored.held), [0.05, 0.95])
    assert ends.low == pytest.approx(low, rel=0.03) and ends.high == pytest.approx(high, rel=0.03)
    assert replace(made[0.0], likelihood_interval=None) == made[np.inf]


def test_checks_stay_what_they_were(told, finished):
    checks = json.loads((finished.folder / "checks.json").read_text(encoding="utf-8"))
    assert set(checks) == {"checks", "rhat", "ess_bulk", "ess_tail"}
    assert "identifiability" not in checks["checks"]
    # The default sampler's own check is among them: with this seed it draws one of the two fits itself.
    k = checks["checks"]["pareto_k"]
    assert k["passed"] == (k["value"] < k["bound"]) and k["bound"] == 0.7 and "surrogate" in k["detail"]


def test_a_folder_of_an_older_program_still_gets_its_report(finished, descents, tmp_path: Path):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    (folder / "identifiability.json").unlink()
    stage_list.report(Job(load_study(descents.study), folder, False, "", lambda *_: None))
    assert "identifiability" not in json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert "contains no identifiability analysis" in (folder / "report.html").read_text(encoding="utf-8")


def test_the_report_says_it_in_words(finished):
    page = (finished.folder / "report.html").read_text(encoding="utf-8")
    section = re.sub(r"<[^>]+>", " ", page.split('id="identifiability"')[1].split("</section>")[0])
    assert "The data determine 2 of 2 parameters" in section
    assert "nan" not in section and "None" not in section


def test_labels_of_the_capsule_are_those_of_its_noise_parameters(cluster: Path):
    study = load_study(cluster)
    labels, used = noise_labels(Job(study, cluster.parent, False, "", lambda *_: None))
    hyper = assemble.hyper(study)
    count = 3 * len(study.noise.channels()) + sum(np.size(law) for law in hyper.disturbance_parameters)
    assert len(set(labels)) == len(labels) == count and used.all()


def test_draws_and_their_log_likelihood_belong_together(job):
    """With the log prior it is the density that the sampler drew from."""
    for group in groups(job):
        stored, (prior,) = load_fit(job, group), group.priors
        likelihood = stage_identifiability.log_likelihood(job, group)
        xi = (stored.held[..., 0] - float(stored.marginal.centre[0])) / float(stored.marginal.scale[0, 0])
        density = np.asarray(log_density(stored.marginal, jnp.asarray(xi[0][None])))
        apart = likelihood[0] - 0.5 * ((stored.held[0, :, 0] - prior.centre) / prior.scale) ** 2 - density
        assert np.ptp(density) > 1.0
        np.testing.assert_allclose(apart, apart[0], rtol=1e-8)


def test_power_scaling_is_that_of_the_stored_posterior_by_arviz(told, finished):
    with xr.open_datatree(finished.folder / "posterior.nc", engine="h5netcdf") as tree:
        own = tree.assign(posterior=tree["conditional"])
        for flight in ("low", "high"):
            name = f"cds_over_mass[{flight}]"
            made = arviz_stats.psense_summary(own, name, prior_var_names=name, likelihood_var_names=flight, round_to=9)
            facts = told[flight]["parameters"][name]
            assert made.loc[name, "prior"] == pytest.approx(facts["prior_sensitivity"], rel=1e-6)
            assert made.loc[name, "likelihood"] == pytest.approx(facts["likelihood_sensitivity"], rel=1e-6)
            counted = arviz_stats.loo(tree, var_name=flight).n_data_points
            assert counted == int(np.isfinite(tree["observed_data"][flight]).sum()) > 40
