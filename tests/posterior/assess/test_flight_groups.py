"""Groups with an entry per flight, and what ArviZ makes of a stored posterior."""

from __future__ import annotations

from dataclasses import replace

import arviz_plots
import arviz_stats
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from tests.twins import small_cluster

from bayeschute.core.errors import InputError
from bayeschute.posterior import sampler
from bayeschute.posterior.assess import flight_groups
from bayeschute.posterior.assess.data_tree import data_tree
from bayeschute.posterior.assess.flight_groups import for_loo_pit, outputs_of
from bayeschute.posterior.assess.identifiability import power_scaling
from bayeschute.posterior.marginal import linear_residuals, log_density, sample_log_likelihoods
from bayeschute.posterior.noise_uncertainty import widened

CHAINS, DRAWS, NAMES = 2, 300, ("first", "the-second")
PREDICTIONS = ("posterior_predictive", "one_step_predictive", "prior_predictive")


@pytest.fixture(scope="module")
def draws(found):
    return sampler.sample(found.marginal, "nuts", CHAINS, 200, DRAWS, seed=1)


@pytest.fixture(scope="module")
def stored(found, draws, descent, tmp_path_factory):
    """A posterior widened by what is not known of the noise parameters, written and read back."""
    wide = widened(draws.xi, found.noise_effect, found.noise_parameter_covariance, 1)
    times = [7.0 + 0.5 * np.arange(101), np.arange(101) / 2.0]
    path = tmp_path_factory.mktemp("stored") / "posterior.nc"
    data_tree(found.marginal, descent.priors, draws, 1, NAMES, wide=wide, times=times).to_netcdf(
        path, engine="h5netcdf"
    )
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        return tree.load()


def test_dimensions_have_names_and_coordinates(stored, descent):
    for i, (name, flight) in enumerate(zip(NAMES, descent.flights, strict=True)):
        seen = flight.present[:, 0]
        for group in ("observed_data", *PREDICTIONS):
            made = stored[group][name]
            assert made.dims[-2:] == (f"time_{name}", "channel")
            assert list(made["channel"].values) == ["descent_rate"] and list(made["units"].values) == ["m/s"]
            np.testing.assert_array_equal(made[f"time_{name}"], (7.0 - 7.0 * i + 0.5 * np.arange(101))[seen])
            assert made[f"time_{name}"].attrs["units"] == "s"
        assert stored["log_likelihood"][name].dims == ("chain", "draw", f"time_{name}")
        np.testing.assert_array_equal(stored["observed_data"][name].values[:, 0], flight.observed[seen, 0])


def test_predictions_are_thinned_by_a_stated_number(stored, found, draws, monkeypatch):
    thin = stored["posterior_predictive"].attrs["thin"]
    assert thin == 2 and CHAINS * DRAWS / thin <= flight_groups.MOST_DRAWS
    for group in PREDICTIONS[:2]:
        assert list(stored[group]["draw"].values) == list(range(0, DRAWS, thin))
        assert stored[group]["first"].dtype == np.float32
    assert stored["log_likelihood"].sizes["draw"] == DRAWS
    monkeypatch.setattr(flight_groups, "MOST_BYTES", 4 * 101 * 60)
    before = np.full((5, 1), found.marginal.centre)
    made = flight_groups.flight_groups(found.marginal, draws.xi, before, NAMES, None, np.random.default_rng(1))
    assert made["posterior_predictive"].attrs["thin"] == 10
    assert made["posterior_predictive"]["first"].sizes["draw"] == 30 and made["prior_predictive"].sizes["draw"] == 5


def test_predictions_may_be_left_out(found, draws):
    before, rng = np.full((5, 1), found.marginal.centre), np.random.default_rng(1)
    made = flight_groups.flight_groups(found.marginal, draws.xi, before, NAMES, None, rng, predictions=False)
    assert set(made) == {"observed_data", "log_likelihood"}


def test_log_likelihood_and_log_prior_sum_to_the_density_that_was_drawn(stored, draws):
    total = sum(stored["log_likelihood"][name].sum(f"time_{name}") for name in NAMES)
    total = total + sum(stored["log_prior"].ds.data_vars.values())
    apart = (total - stored["sample_stats"]["lp"]).values
    assert np.ptp(draws.log_density) > 2.0
    np.testing.assert_allclose(apart, apart[0, 0], rtol=1e-8)
    assert stored["log_likelihood"].attrs["lp_error"] < 1e-8 * abs(apart[0, 0])


def test_determinant_and_prices_are_shared_by_recorded_data(straight, linear):
    """The linear flight, given a determinant that is not flat and innovations that bend (as in test_marginal)."""
    (along,), present = straight.along, np.asarray(linear.flight.present)
    unit = jnp.concatenate([along.unit[..., :1], 0.0 * along.unit[..., 1:]], axis=2)
    tilted = straight.determinant._replace(slope=np.array([0.7, -0.2]))
    bent = replace(straight, determinant=tilted, along=(along._replace(unit=unit),))
    xi = np.array([[0.4, -1.5, 0.0], [1.0, 0.3, 0.0]])
    (rows,), (plain,) = sample_log_likelihoods(bent, xi), sample_log_likelihoods(straight, xi)
    prices = 0.5 * linear_residuals(bent, xi)[1][0] ** 2
    assert (np.asarray(prices)[:2] > 0.9).all()
    wanted = -np.outer(present.sum(axis=1), (np.array([0.7, -0.2]) @ xi + prices) / present.sum())
    np.testing.assert_allclose(rows - plain, wanted, atol=1e-8)
    assert not np.asarray(rows)[~present.any(axis=1)].any()
    z = np.linalg.solve(straight.prior_factor, np.asarray(bent.theta(xi)) - straight.prior_centre[:, None])
    apart = np.asarray(rows).sum(axis=0) - 0.5 * np.sum(z**2, axis=0) - log_density(bent, xi)
    np.testing.assert_allclose(apart, apart[2], rtol=1e-8)


def test_posterior_predictions_have_the_spread_of_the_noise(found, stored):
    for name, flight in zip(NAMES, found.marginal.flights, strict=True):
        made = stored["posterior_predictive"][name].values[..., 0].reshape(-1, flight.present.sum())
        z = (flight.observed[flight.present] - made.mean(axis=0)) / made.std(axis=0)
        assert 0.3 < np.sqrt(np.mean(z**2)) < 1.5
        total = np.hypot(found.hyper.noise.white, found.hyper.noise.correlated)
        assert 0.9 * total < made.std(axis=0).mean() < 2.0 * total


def test_one_step_predictions_have_the_density_of_the_log_likelihood(straight, linear):
    """The linear flight's, both outputs: their mean and covariance at a sample, from the log likelihood itself."""
    xi, rng = np.zeros((2, 20_000)), np.random.default_rng(4)
    (made,) = flight_groups._one_step(straight, xi, rng)
    assert (np.isnan(made[..., 0]) == ~linear.flight.present).all()
    t = int(np.flatnonzero(linear.flight.present.all(axis=1))[20])
    root = np.asarray(straight.along[0].gains.root)[t]
    off = linear.flight.observed[t] - made[t].mean(axis=1)
    covariance = np.cov(made[t])
    np.testing.assert_allclose(covariance, root @ root.T, rtol=0.06)
    level = -0.5 * off @ np.linalg.solve(covariance, off) - 0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1]
    assert level == pytest.approx(float(sample_log_likelihoods(straight, xi[:, :1])[0][t, 0]), abs=0.06)


def test_prior_predictions_are_flights_of_the_prior_draws(stored, descent, found):
    """Late in the flight the descent rate goes with one over the root of C_D S/m, whatever the start and gusts."""
    made = stored["prior_predictive"]["first"]
    assert made.sizes["draw"] == flight_groups.PRIOR_DRAWS and made.attrs["failed"] == 0.0
    drag = stored["prior"]["cds_over_mass"].values[0, : flight_groups.PRIOR_DRAWS]
    late = made.values[0, :, -20:, 0].mean(axis=1)
    slope, _ = np.polyfit(np.log(drag), np.log(late), 1)
    assert slope == pytest.approx(-0.5, abs=0.05)
    seen = stored["posterior_predictive"]["first"].values[..., -20:, 0].mean(axis=-1)
    assert late.std() > 4.0 * seen.std()


def test_prior_flights_that_fail_are_counted(found, draws, monkeypatch):
    honest = flight_groups.states

    def some(flight, theta, driven):
        path = np.array(honest(flight, theta, driven))
        path[50:, :, 3] = np.inf
        return jnp.asarray(path)

    monkeypatch.setattr(flight_groups, "states", some)
    before = np.full((8, 1), float(found.marginal.centre[0]))
    made = flight_groups.flight_groups(found.marginal, draws.xi, before, NAMES, None, np.random.default_rng(1))
    first = made["prior_predictive"]["first"]
    assert first.attrs["failed"] == 0.125 and np.isnan(first.values[0, 3]).all()
    assert np.isfinite(np.delete(first.values[0], 3, axis=0)).all()


def test_channels_of_a_cluster_have_names_and_units(descent):
    model = small_cluster.flight(
        small_cluster.cluster(),
        small_cluster.start(np.array([[0.2, -0.2], [0.0, 0.0], [-1.0, -1.0]])),
        channels=("canopy_position", "capsule_attitude", "riser_tension"),
    )
    names, units = outputs_of(replace(descent.flights[0], model=model))
    table = dict(zip(names, units, strict=True))
    assert len(table) == 6 + 3 + 2
    assert table["canopy_position.1.north"] == "m" and table["capsule_attitude.x"] == "rad"
    assert table["riser_tension.2"] == "N"


def test_channels_that_one_flight_lacks_are_nan():
    def flight(name, channels):
        rows = np.ones((3, len(channels)))
        return xr.Dataset(
            {name: ((f"time_{name}", "channel"), rows)},
            {"channel": channels, "units": ("channel", ["m"] * len(channels))},
        )

    made = flight_groups.joined([flight("a", ["x", "y"]), flight("b", ["y"])])
    assert list(made["channel"].values) == ["x", "y"] and list(made["units"].values) == ["m", "m"]
    assert np.isnan(made["b"].sel(channel="x")).all() and made["b"].sel(channel="y").sum() == 3.0


def test_arviz_reads_what_was_stored(stored):
    assert list(arviz_stats.summary(stored).index) == ["cds_over_mass"]
    assert set(arviz_stats.psense_summary(stored).columns) >= {"prior", "likelihood"}
    told = arviz_stats.compare({"one": stored, "other": stored.copy()}, var_name="first")
    assert told["elpd_diff"].abs().max() == 0.0
    for plot in (arviz_plots.plot_trace, arviz_plots.plot_pair, arviz_plots.plot_prior_posterior):
        assert plot(stored, backend="none") is not None
    for group in PREDICTIONS:
        arviz_plots.plot_ppc_dist(stored, group=group, num_samples=20, backend="none")
    assert arviz_plots.plot_loo_pit(for_loo_pit(stored, "first"), backend="none") is not None


@pytest.mark.parametrize("name", NAMES)
def test_loo_is_that_of_the_samples(stored, name):
    """The importance-weighted density of every sample, by hand; no Pareto k is bad, so smoothing hardly matters."""
    told = arviz_stats.loo(stored, var_name=name, pointwise=True)
    rows = stored["log_likelihood"][name].values.reshape(CHAINS * DRAWS, -1)
    by_hand = -np.log(np.mean(np.exp(-rows), axis=0))
    assert told.n_data_points == rows.shape[1] and not told.warning
    np.testing.assert_allclose(told.elpd_i, by_hand, atol=5e-3)
    assert told.elpd == pytest.approx(by_hand.sum(), abs=0.02)
    assert 0.2 < told.p < 2.0  # one parameter


def test_one_step_predictions_are_calibrated_and_those_given_the_record_are_not(stored):
    """A variance of one in units of the uniform law's; the standard error is about 0.9 / sqrt(167)."""
    ranks = [arviz_stats.loo_pit(for_loo_pit(stored, name, "descent_rate"))[name].values for name in NAMES]
    assert 12.0 * np.concatenate(ranks).var() == pytest.approx(1.0, abs=0.2)
    given = [
        (stored["posterior_predictive"][name] < stored["observed_data"][name]).mean(("chain", "draw")) for name in NAMES
    ]
    assert 12.0 * np.concatenate([part.values.ravel() for part in given]).var() < 0.7


def test_loo_pit_is_of_recorded_data_alone(stored):
    holes = stored.copy(deep=True)
    holes["observed_data"]["first"].values[5:9] = np.nan
    whole, fewer = (arviz_stats.loo_pit(for_loo_pit(tree, "first"))["first"].values for tree in (stored, holes))
    np.testing.assert_array_equal(fewer, np.delete(whole, range(5, 9)))


@pytest.mark.parametrize("given", [("third", None), ("first", "swing_angle")])
def test_unknown_flights_and_channels_are_faults(stored, given):
    with pytest.raises(InputError, match="wanted one of (first|descent_rate)"):
        for_loo_pit(stored, *given)


def test_power_scaling_by_arviz_is_that_of_the_report(stored, descent, found, draws):
    """Exactly, of the sampler's own draws; of the widened ones in size."""
    held = np.asarray(found.marginal.centre) + draws.xi @ np.asarray(found.marginal.scale).T
    likelihood = sum(stored["log_likelihood"][name].values.sum(axis=-1) for name in NAMES)
    report = power_scaling(descent.priors, held, likelihood)["cds_over_mass"]
    own = arviz_stats.psense_summary(stored.assign(posterior=stored["conditional"]), round_to=9).loc["cds_over_mass"]
    assert own["prior"] == pytest.approx(report.prior, rel=1e-6)
    assert own["likelihood"] == pytest.approx(report.likelihood, rel=1e-6)
    wide = arviz_stats.psense_summary(stored, round_to=9).loc["cds_over_mass"]
    assert wide["likelihood"] == pytest.approx(report.likelihood, rel=0.5) and wide["prior"] < 0.05
