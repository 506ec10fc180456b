"""Bands of a small descent: what varies, what fails, what is counted."""

from __future__ import annotations

import warnings
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from tests.twins import dense_noise as twin

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData, NoiseParameters, Unknowns, latent_path_of, residuals
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import marginalise
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.prediction import bands, held_shares
from bayeschute.prediction.bands import Prediction

GUSTS = Latent(("drift",), ((0, 0),))
HYPER = NoiseParameters(Noise(np.array([0.05]), np.array([0.1]), np.array([2.0])), (np.array([0.4, 12.0]),))
THETA, SAMPLES, DT, DRAWS = np.array([np.log(0.2)]), 101, 0.5, 80
PRIORS = [Prior("cds_over_mass", float(THETA[0]) + 0.1, 0.3, True, "m^2/kg", "")]


@pytest.fixture(scope="module")
def flight():
    """A descent with data drawn from its own law, and its noise-free descent rate."""
    air = DensityProfile(0.0, 500.0, np.log(1.225) - 500.0 * np.arange(8) / 9000.0)
    model = DescentFlight(air, DescentInputs(np.zeros(SAMPLES)), 2500.0, 10.0, DT, Stepping(2))
    times, nothing = DT * np.arange(SAMPLES), np.zeros((SAMPLES, 1))
    empty = FlightData(model, nothing, nothing == 0.0, DT, np.array([2.0]), (0,), GUSTS)
    rng = np.random.default_rng(4)
    u = Unknowns(np.array([0.35]), rng.standard_normal((SAMPLES, 1)))
    clean = -np.asarray(residuals(empty, jnp.asarray(THETA), latent_path_of(empty, HYPER, u)))
    covariance = twin.noise_covariance(times, nothing == 0.0, *HYPER.noise.__dict__.values())
    noise = np.linalg.cholesky(covariance) @ rng.standard_normal(SAMPLES)
    return SimpleNamespace(data=replace(empty, observed=clean + noise[:, None]), clean=clean[:, 0])


@pytest.fixture(scope="module")
def fitted(flight):
    best = fit([flight.data], HYPER, PRIORS, THETA)
    return marginalise([flight.data], HYPER, PRIORS, best)


def _theta(marginal, draws=DRAWS, seed=0):
    xi = np.random.default_rng(seed).standard_normal((1, draws))
    return np.array(marginal.theta(jnp.asarray(xi))).T


def _laws(covariance=1e-12):
    return bands.noise_parameter_draws(HYPER, covariance * np.eye(5), 5, np.random.default_rng(1))


@pytest.fixture(scope="module")
def smoothed(fitted):
    return bands.predict(fitted, 0, _theta(fitted), _laws(), seed=5)


@pytest.fixture(scope="module")
def begun(flight):
    """What the flight's first ten seconds say."""
    posterior = [replace(PRIORS[0], centre=float(THETA[0]), scale=0.05)]
    return bands.opened(bands.opening(flight.data, 10.0), HYPER, posterior)


@pytest.fixture(scope="module")
def forecast(flight, begun):
    """The flight known by its first ten seconds."""
    return bands.predict(begun, 0, np.tile(THETA, (DRAWS, 1)), _laws(), 6, flight.data, 10.0)


def test_shapes_and_the_last_velocity(smoothed):
    assert set(smoothed.draws) == {"descent_rate", "sea_level_descent_rate"}
    assert smoothed.draws["descent_rate"].shape == (DRAWS, SAMPLES) and smoothed.failed == 0
    assert smoothed.last.shape == (DRAWS, 3)
    np.testing.assert_array_equal(smoothed.last[:, 2], smoothed.draws["descent_rate"][:, -1])
    np.testing.assert_array_equal(smoothed.last[:, :2], 0.0)
    np.testing.assert_allclose(smoothed.time, DT * np.arange(SAMPLES))


def test_a_fitted_flight_is_smoothed(smoothed, flight):
    made = smoothed.draws["descent_rate"]
    z = (made.mean(axis=0) - flight.clean) / made.std(axis=0)
    assert np.sqrt(np.mean(z**2)) < 2.0
    assert made.std(axis=0).mean() < 0.12  # narrower than the noise of one sample
    assert held_shares.coverage(made, flight.clean, np.ones(SAMPLES, bool)) > 0.6


def test_a_forecast_widens_after_its_opening_and_holds_the_truth(forecast, flight):
    made = forecast.draws["descent_rate"]
    width = made.std(axis=0)
    assert width[60:].mean() > 2.0 * width[:15].mean()
    # Far beyond the data, the spread is that of the stationary wind error, which the descent rate nearly follows.
    assert 0.5 * 0.4 < width[80:].mean() < 1.3 * 0.4
    z = (made.mean(axis=0) - flight.clean) / width
    assert np.sqrt(np.mean(z**2)) < 2.5


def test_shares_sum_to_one(smoothed, forecast):
    for made in (smoothed, forecast):
        for share in made.shares.values():
            assert set(share) == {"parameter", "initial state", "wind"}
            assert sum(share.values()) == pytest.approx(1.0) and min(share.values()) >= 0.0
    assert forecast.shares["descent_rate"]["parameter"] < 1e-6  # no spread of parameters was given
    assert forecast.shares["descent_rate"]["wind"] > 0.9


def test_seeds_make_predictions(fitted, smoothed):
    again = bands.predict(fitted, 0, _theta(fitted), _laws(), seed=5)
    other = bands.predict(fitted, 0, _theta(fitted), _laws(), seed=7)
    np.testing.assert_array_equal(again.draws["descent_rate"], smoothed.draws["descent_rate"])
    assert not np.array_equal(other.draws["descent_rate"], smoothed.draws["descent_rate"])


@pytest.mark.parametrize("log_area", [3.0, 6.0, 20.0, 60.0, 150.0])  # drag areas at which the integration blows up
def test_a_failed_simulation_is_counted_and_left_empty(fitted, log_area):
    theta = _theta(fitted)
    theta[3] = log_area
    heard = []
    made = bands.predict(fitted, 0, theta, _laws(), seed=5, progress=heard.append)
    assert made.failed == 1 and heard[-1] == 1.0
    assert np.isnan(made.draws["descent_rate"][3]).all() and np.isnan(made.last[3]).all()
    assert np.isfinite(np.delete(made.draws["descent_rate"], 3, axis=0)).all()
    for share in made.shares.values():
        assert sum(share.values()) == pytest.approx(1.0)
    kept = held_shares.coverage(made.draws["descent_rate"], np.full(SAMPLES, 10.0), np.ones(SAMPLES, bool))
    assert kept is not None


def test_opening_is_a_flight_of_its_own(flight, begun):
    part = bands.opening(flight.data, 10.0)
    assert part.samples == 21 and part.present.shape == (21, 1) and part.model.record.wind.shape == (21,)
    np.testing.assert_array_equal(part.observed, flight.data.observed[:21])
    assert part.latent is flight.data.latent and part.starts == 1
    whole = bands.opening(flight.data, 1e6)
    assert whole.samples == SAMPLES and whole.model.record.wind.shape == (SAMPLES,)
    assert abs(float(begun.centre[0]) - THETA[0]) < 0.05  # the opening hardly moves what the posterior says


def test_groups_of_draws_have_noise_parameters_of_their_own(flight, begun):
    """Beyond the data the wind of every second group is wild; a prediction takes the laws in turn."""
    laws = [replace(HYPER, disturbance_parameters=(np.array([sd, 12.0]),)) for sd in (0.05, 1.2)]
    made = bands.predict(begun, 0, np.tile(THETA, (DRAWS, 1)), laws, 6, flight.data, 10.0).draws["descent_rate"]
    wild = np.arange(DRAWS) // bands.GROUP % 2 == 1
    assert made[wild, 80:].std() > 6.0 * made[~wild, 80:].std()
    assert made[wild, :15].std(axis=0).mean() < 3.0 * made[~wild, :15].std(axis=0).mean()


def test_the_wind_beyond_the_data_has_the_conditional_law(flight, begun):
    """Mean and spread of the descent rate against the wind's kernel given what the opening leaves of it."""
    draws, calm = 640, replace(HYPER, disturbance_parameters=(np.array([0.4, 4.0]),))
    made = bands.predict(begun, 0, np.tile(THETA, (draws, 1)), [calm], 6, flight.data, 10.0).draws["descent_rate"]
    # Long after the opening the rate follows the stationary wind, slowed down by the body's own response.
    late, lag = made[:, -10:], 8
    speed = made[:, 60:].mean()
    tau = speed / (2.0 * 9.80665)  # first-order response to the wind
    sd = 0.4 * np.sqrt(4.0 / (4.0 + tau))
    assert late.std(axis=0).mean() == pytest.approx(sd, rel=0.1)
    wanted = (4.0 * np.exp(-lag * DT / 4.0) - tau * np.exp(-lag * DT / tau)) / (4.0 - tau)
    pairs = np.mean((made[:, 60:-lag] - made[:, 60:-lag].mean(0)) * (made[:, 60 + lag :] - made[:, 60 + lag :].mean(0)))
    assert pairs / late.var() == pytest.approx(wanted, abs=0.1)


def test_gusts_beyond_the_data_may_be_stronger_or_weaker(flight, begun):
    """A log-normal factor a draw: nothing changes before, and far beyond it multiplies every draw's departure."""
    theta, given = np.tile(THETA, (640, 1)), (_laws()[:1], 6, flight.data, 10.0)
    same, other = (
        bands.predict(begun, 0, theta, *given, disturbance_log_sd=s).draws["descent_rate"] for s in (0.0, 0.5)
    )
    np.testing.assert_array_equal(same[:, :21], other[:, :21])
    departure = [made[:, -1] - same[:, -1].mean() for made in (same, other)]
    assert np.std(departure[1]) / np.std(departure[0]) == pytest.approx(np.exp(0.5**2), rel=0.15)
    assert np.corrcoef(*departure)[0, 1] > 0.8


def test_held_out_data_are_not_followed(flight, fitted, smoothed):
    """Told for twenty seconds only, a fitted flight is smoothed until then and drifts apart after."""
    made = bands.predict(fitted, 0, _theta(fitted), _laws(), 5, data_end=20.0).draws["descent_rate"]
    before = smoothed.draws["descent_rate"]
    np.testing.assert_array_equal(made[: bands.GROUP, :41], before[: bands.GROUP, :41])  # numbers of the first group
    assert made[:, 60:].std(axis=0).mean() > 2.0 * before[:, 60:].std(axis=0).mean()


def test_law_draws_have_the_covariance_of_their_logarithms():
    rng, hyper = (
        np.random.default_rng(9),
        replace(HYPER, disturbance_parameters=(np.array([0.4, 12.0]), np.array([0.3, 0.2, 0.15]))),
    )
    root = 0.2 * rng.standard_normal((8, 8))
    covariance = root @ root.T + 0.01 * np.eye(8)
    made = bands.noise_parameter_draws(hyper, covariance, 800, rng)
    assert jax.tree.structure(made[0]) == jax.tree.structure(hyper) and [
        law.size for law in made[0].disturbance_parameters
    ] == [2, 3]
    logs = np.array([np.log(np.concatenate(jax.tree.leaves(law))) for law in made]).T
    centre = np.log(np.concatenate(jax.tree.leaves(hyper)))
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((logs.mean(axis=1) - centre) / sd, 0.0, atol=4.0 / np.sqrt(800))
    np.testing.assert_allclose((np.cov(logs) - covariance) / np.outer(sd, sd), 0.0, atol=6.0 / np.sqrt(800))


def test_every_group_is_carried_along_with_its_noise_parameters(fitted):
    """Groups take noise parameters in turn, and draws of a group are carried along with those it takes."""
    laws, theta = _laws(0.02), _theta(fitted, draws=7 * bands.GROUP - 3)
    spread = np.array([1.0, 0.5, 0.0, -0.3, 0.0])[:, None, None]
    effect = NoiseEffect(np.array([[0.3, -0.2, 0.0, 0.1, 0.0]]), spread, np.array([[0.2]]))
    made = bands.carried(fitted, theta, laws, effect)
    centre, sd = float(fitted.centre[0]), float(fitted.scale[0, 0])
    for i, (one, given) in enumerate(zip(made[:, 0], theta[:, 0], strict=True)):
        law = laws[i // bands.GROUP % len(laws)]
        off = np.log(np.concatenate(jax.tree.leaves(law))) - np.log(np.concatenate(jax.tree.leaves(HYPER)))
        stretch = np.exp(0.1 + 0.5 * off @ spread[:, 0, 0])
        assert one == pytest.approx(centre + stretch * (given - centre) + sd * float(effect.slope[0] @ off), rel=1e-12)
    np.testing.assert_allclose(bands.carried(fitted, theta, laws, NoiseEffect.none(1, 5)), theta, rtol=1e-12)


def test_a_prediction_that_failed_altogether_has_no_shares(fitted, monkeypatch):
    monkeypatch.setattr(bands, "_simulate", _lost(bands._simulate))
    made = bands.predict(fitted, 0, np.tile(np.asarray(fitted.centre), (4, 1)), [fitted.hyper], 3)
    assert made.failed == 4 and np.isnan(made.draws["descent_rate"]).all()
    assert all(np.isnan(share) for share in made.shares["descent_rate"].values())
    time = np.arange(made.time.size)
    held = bands.dataset(made, made.time, ("descent_rate",), None, {}, time > 80, "identify")
    assert np.isnan(held["descent_rate"]).all() and held.attrs["failed"] == 4


def test_shares_are_those_of_the_draws_that_do_not_fail(fitted, monkeypatch):
    honest = bands._simulate

    def partly(*given):
        """The last flight of every batch leaves the finite numbers halfway."""
        quantities, last = (np.array(part) for part in honest(*given))
        quantities[:, quantities.shape[1] // 2 :, -1] = np.inf
        return quantities, last

    theta = np.asarray(fitted.centre) + np.random.default_rng(0).normal(size=(bands.GROUP, 1)) * fitted.scale[0, 0]
    whole = bands.predict(fitted, 0, theta, [fitted.hyper], 3)
    monkeypatch.setattr(bands, "_simulate", partly)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = bands.predict(fitted, 0, theta, [fitted.hyper], 3)
    assert made.failed == 1 and np.isnan(made.draws["descent_rate"]).all(axis=1).sum() == 1
    for name, share in made.shares.items():
        assert sum(share.values()) == pytest.approx(1.0)
        for source, value in share.items():
            assert value == pytest.approx(whole.shares[name][source], abs=0.2)


def _lost(honest):
    """Simulations that fail."""
    return lambda *given: tuple(np.nan * np.asarray(part) for part in honest(*given))


def test_coverage_of_gaussian_draws_is_ninety_percent():
    rng = np.random.default_rng(10)
    made = held_shares.coverage(rng.standard_normal((4000, 3000)), rng.standard_normal(3000), np.ones(3000, bool))
    assert made == pytest.approx(0.9, abs=0.025)


def test_dataset(smoothed, flight):
    truth = xr.Dataset({"descent_rate": ("time", flight.clean)})
    held = np.arange(SAMPLES) > 80
    record = {"descent_rate": flight.data.observed[:, 0]}
    made = bands.dataset(smoothed, smoothed.time, ("descent_rate", "swing_angle"), truth, record, held, "identify")
    assert made["descent_rate"].dims == ("quantile", "time") and "swing_angle" not in made
    assert (np.diff(made["descent_rate"].values, axis=0) >= 0.0).all()
    np.testing.assert_array_equal(made["descent_rate_truth"], flight.clean)
    np.testing.assert_array_equal(made["descent_rate_record"], record["descent_rate"])
    assert made["variance_share"].sum("source").item() == pytest.approx(1.0)
    assert made.attrs == {"role": "identify", "failed": 0} and made["held_out"].sum() == 20


def test_draws_are_stored_thinned_and_packed(smoothed, monkeypatch, tmp_path):
    count, held = len(smoothed.draws["descent_rate"]), np.arange(SAMPLES) > 80
    assert count > 20
    monkeypatch.setattr(bands, "MOST_DRAWS", 20)
    made = bands.dataset(smoothed, smoothed.time, ("descent_rate",), None, {}, held, "identify")
    xr.DataTree.from_dict({"/one": made}).to_netcdf(tmp_path / "predictions.nc", engine="h5netcdf")
    with xr.open_datatree(tmp_path / "predictions.nc", engine="h5netcdf") as tree:
        back = tree["one"]["descent_rate_draws"].load()
    thin = back.attrs["thin"]
    assert back.dims == ("draw", "time") and back.attrs["units"] == "m/s" and back.dtype == np.float32
    assert thin == -(-count // 20) and list(back["draw"].values) == list(range(0, count, thin))
    np.testing.assert_allclose(back, smoothed.draws["descent_rate"][::thin], rtol=1e-6)
    assert back.encoding["zlib"]


def test_recorded_draws_carry_the_noise_of_the_instrument():
    still = Prediction(DT * np.arange(400), {"descent_rate": np.zeros((200, 400))}, np.zeros((200, 3)), 0, {})
    assert bands.recorded_draws(still, "descent_rate", None, 1) is still.draws["descent_rate"]
    made = bands.recorded_draws(still, "descent_rate", (0.3, 0.4, 2.0), 1)
    assert made.shape == (200, 400) and made.std() == pytest.approx(0.5, rel=0.03)
    lag = np.mean(made[:, 1:] * made[:, :-1])
    assert lag == pytest.approx(0.16 * np.exp(-DT / 2.0), abs=0.02)
