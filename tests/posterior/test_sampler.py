"""The whole way: found, drawn, kept in a DataTree, read back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from bayeschute.posterior import sampler
from bayeschute.posterior.assess import flight_groups
from bayeschute.posterior.marginal import log_density, projected_residuals, sample_log_likelihoods
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.posterior.sampling import independence
from bayeschute.posterior.sampling.independence import Proposal
from bayeschute.posterior.sampling.sampler_checks import why_not_trusted

CHAINS, DRAWS, NAMES = 2, 120, ("first", "second")
GROUPS = {"posterior", "prior", "sample_stats", "log_prior", "constant_data", *flight_groups.GROUPS}


@pytest.fixture(scope="module")
def draws(found):
    return sampler.sample(found.marginal, "nuts", CHAINS, 200, DRAWS, seed=1)


@pytest.fixture(scope="module")
def tree(found, draws, descent):
    return sampler.data_tree(found.marginal, descent.priors, draws, 1, NAMES)


def test_widened_draws_are_the_posterior_and_the_samplers_own_are_kept(found, draws, descent, tree):
    wide = widened(draws.xi, found.noise_effect, found.noise_parameter_covariance, 1)
    made = sampler.data_tree(found.marginal, descent.priors, draws, 1, NAMES, wide=wide)
    name = descent.priors[0].name
    xr.testing.assert_identical(made["conditional"][name], tree["posterior"][name])
    theta = np.asarray(found.marginal.centre) + wide @ np.asarray(found.marginal.scale).T
    np.testing.assert_allclose(np.log(made["posterior"][name]), theta[..., 0])
    assert made["posterior"][name].attrs["units"] == tree["posterior"][name].attrs["units"]
    for group in ("log_likelihood", "log_prior", "sample_stats"):  # at the draws of the sampler
        xr.testing.assert_equal(made[group].ds, tree[group].ds)
        assert made[group].attrs["draws"] == made["conditional"].attrs["draws"] != made["posterior"].attrs["draws"]
    assert "conditional" not in tree


def test_noise_parameters_stand_by_name(found, draws, descent, tree):
    hyper = found.marginal.hyper
    channels, groups = len(np.asarray(hyper.noise.white)), [np.asarray(g) for g in hyper.disturbance_parameters]
    names = [f"sensor {i}" for i in range(channels)], [f"gusts {i}" for i in range(len(groups))]
    made = sampler.data_tree(found.marginal, descent.priors, draws, 1, NAMES, predictions=False, noise_names=names)
    told = made["constant_data"].ds
    assert list(told.data_vars) == [*names[0], *names[1]]
    assert set(tree["constant_data"].ds.data_vars) >= {"channel 1"}
    for key in ("white", "correlated", "time_constant"):
        got = [float(told[name].sel(noise_parameter=key)) for name in names[0]]
        np.testing.assert_array_equal(got, getattr(hyper.noise, key))
    for name, group in zip(names[1], groups, strict=True):
        assert float(told[name].sel(noise_parameter="correlated")) == group[0]
        np.testing.assert_array_equal(told[name].values[np.isfinite(told[name].values)], group)


def test_draws_are_nearly_standard(draws):
    assert draws.xi.shape == (CHAINS, DRAWS, 1) and draws.failed == 0
    assert abs(draws.xi.mean()) < 0.35 and draws.xi.std() == pytest.approx(1.0, abs=0.2)
    assert draws.stats["acceptance_rate"].mean() > 0.9


def test_draws_carry_their_log_density(found, draws):
    flat = draws.xi.reshape(-1, 1).T
    np.testing.assert_allclose(draws.log_density.ravel(), log_density(found.marginal, flat), atol=1e-8)


@pytest.fixture(scope="module")
def asked(found):
    """emcee's draws, asked for."""
    return sampler.sample(found.marginal, "emcee", 1, 0, 400, seed=2)


def test_emcee_agrees(asked, draws):
    assert asked.xi.shape == (1, 400, 1)
    np.testing.assert_allclose(np.quantile(asked.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


def test_good_draws_come_without_a_word(draws):
    assert draws.notes == () and draws.stats["log_ratio"].shape == (CHAINS, DRAWS)
    assert why_not_trusted(draws) == ""


@pytest.mark.parametrize("longest", [4, 16])
def test_a_walk_that_mixes_slowly_is_made_longer(found, draws, longest, monkeypatch):
    verdicts, heard = iter((True, longest == 16, False)), []
    monkeypatch.setattr(sampler, "mixes_slowly", lambda made: next(verdicts))
    other = sampler.sample(
        found.marginal, "nuts", CHAINS, 200, DRAWS, 2, lambda share, words: heard.append(words.split(":")[0])
    )
    assert other.notes == () and other.xi.shape == draws.xi.shape and why_not_trusted(other) == ""
    assert list(dict.fromkeys(heard)) == ["nuts", *(f"nuts, {n} times as long" for n in (4, 16) if n <= longest)]
    assert other.evaluations > 3 * draws.evaluations
    np.testing.assert_allclose(np.quantile(other.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


@pytest.fixture
def broken(monkeypatch):
    """A surrogate whose density is three times too narrow: NUTS on it sticks (k of the ratios is 8/9).

    The draws of a study (4 chains of 500) notice with twelve seeds of twelve, 2 of 300 with eleven.
    """
    build = sampler.build

    def narrow(*given):
        made, failed = build(*given)
        return replace(made, factor=3.0 * made.factor), failed

    monkeypatch.setattr(sampler, "build", narrow)


def test_a_broken_surrogate_gives_way_to_independent_proposals(found, draws, broken):
    heard = []
    other = sampler.sample(found.marginal, "nuts", 4, 300, 500, 2, lambda share, words: heard.append(words))
    assert len(other.notes) == 1 and "independence sampler drew instead" in other.notes[0]
    assert "Pareto k" in other.notes[0]
    assert "log_ratio" not in other.stats  # they are not the surrogate's draws
    assert any(w.startswith("nuts") for w in heard) and heard[-1].startswith("independence sampler")
    np.testing.assert_allclose(np.quantile(other.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


@pytest.mark.parametrize("lost", [False, True])
def test_broken_proposals_give_way_to_emcee(found, draws, asked, broken, monkeypatch, lost):
    """Proposals a hundred times too narrow, or none at all: emcee on the exact density is the last that is asked."""
    proposal = Proposal(np.zeros(1), np.full((1, 1), 0.01))

    def learned(*_):
        if lost:
            raise FloatingPointError("nothing flies")
        return proposal, np.zeros((8, 1))

    monkeypatch.setattr(independence, "learned", learned)
    other = sampler.sample(found.marginal, "nuts", 1, 200, 400, 2)
    assert len(other.notes) == 1 and "emcee drew instead" in other.notes[0]
    assert ("nothing flies" in other.notes[0]) == lost
    np.testing.assert_array_equal(other.xi, asked.xi)
    assert other.evaluations > asked.evaluations
    np.testing.assert_allclose(np.quantile(other.xi, [0.1, 0.5, 0.9]), np.quantile(draws.xi, [0.1, 0.5, 0.9]), atol=0.4)


def test_log_likelihood_has_the_normaliser_of_the_filter(found):
    flight, along = found.marginal.flights[0], found.marginal.along[0]
    middle = np.zeros((1, 1))
    rows = np.asarray(sample_log_likelihoods(found.marginal, middle)[0])
    unit = np.asarray(projected_residuals(found.marginal, middle))[: flight.observed.size]
    wanted = (
        -0.5 * np.sum(unit**2) - float(along.gains.log_determinant) - 0.5 * flight.present.sum() * np.log(2 * np.pi)
    )
    assert rows.sum() == pytest.approx(wanted, rel=1e-12)


def test_tree_round_trips_through_netcdf(tree, draws, descent, tmp_path):
    assert set(tree.children) == GROUPS
    tree.to_netcdf(tmp_path / "posterior.nc", engine="h5netcdf")
    back = xr.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf")
    assert set(back.children) == GROUPS
    for group in GROUPS:
        xr.testing.assert_allclose(back[group].to_dataset(), tree[group].to_dataset())
    value = back["posterior"]["cds_over_mass"]
    assert value.dims == ("chain", "draw") and value.attrs["units"] == "m^2/kg"
    assert value.mean() == pytest.approx(float(np.exp(descent.theta[0])), rel=0.1)
    assert {"lp", "diverging", "acceptance_rate"} <= set(back["sample_stats"].data_vars)
    np.testing.assert_allclose(back["sample_stats"]["lp"], draws.log_density)
    assert back["log_likelihood"]["first"].sizes["draw"] == DRAWS
    assert back["observed_data"]["first"].values[:, 0] == pytest.approx(
        descent.flights[0].observed[descent.flights[0].present]
    )
    back.close()


def test_log_prior_is_the_density_of_the_working_coordinate(tree, descent):
    p = descent.priors[0]
    z = (np.log(tree["posterior"]["cds_over_mass"].values) - p.centre) / p.scale
    wanted = -0.5 * z**2 - np.log(p.scale * np.sqrt(2.0 * np.pi))
    np.testing.assert_allclose(tree["log_prior"]["cds_over_mass"].values, wanted, atol=1e-10)
