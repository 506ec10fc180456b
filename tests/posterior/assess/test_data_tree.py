"""A posterior as a DataTree: its groups, its own and its widened draws, written and read back."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.posterior import sampler
from bayeschute.posterior.assess import flight_groups
from bayeschute.posterior.assess.data_tree import data_tree
from bayeschute.posterior.noise_uncertainty import widened

CHAINS, DRAWS, NAMES = 2, 120, ("first", "second")
GROUPS = {"posterior", "prior", "sample_stats", "log_prior", "constant_data", *flight_groups.GROUPS}


@pytest.fixture(scope="module")
def draws(found):
    return sampler.sample(found.marginal, "nuts", CHAINS, 200, DRAWS, seed=1)


@pytest.fixture(scope="module")
def tree(found, draws, descent):
    return data_tree(found.marginal, descent.priors, draws, 1, NAMES)


def test_widened_draws_are_the_posterior_and_the_samplers_own_are_kept(found, draws, descent, tree):
    wide = widened(draws.xi, found.noise_effect, found.noise_parameter_covariance, 1)
    made = data_tree(found.marginal, descent.priors, draws, 1, NAMES, wide=wide)
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
    made = data_tree(found.marginal, descent.priors, draws, 1, NAMES, predictions=False, noise_names=names)
    told = made["constant_data"].ds
    assert list(told.data_vars) == [*names[0], *names[1]]
    assert set(tree["constant_data"].ds.data_vars) >= {"channel 1"}
    for key in ("white", "correlated", "time_constant"):
        got = [float(told[name].sel(noise_parameter=key)) for name in names[0]]
        np.testing.assert_array_equal(got, getattr(hyper.noise, key))
    for name, group in zip(names[1], groups, strict=True):
        assert float(told[name].sel(noise_parameter="correlated")) == group[0]
        np.testing.assert_array_equal(told[name].values[np.isfinite(told[name].values)], group)


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
