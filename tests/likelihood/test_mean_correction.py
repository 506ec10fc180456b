"""Mean flight less flight of the mean: none of a linear flight, that of many draws of a bent one."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.likelihood import disturbances, mean_correction
from bayeschute.likelihood.joint import as_seen, filter_gains, latent_path_of, linearise, states
from bayeschute.likelihood.kalman import MeanCorrection, innovations
from bayeschute.posterior.joint_mode import fit


@pytest.fixture(scope="module")
def along(linear):
    """A linear flight linearised on a path that is anything but a flight, and its filter."""
    driven = latent_path_of(linear.flight, linear.hyper, linear.u)
    path = np.asarray(states(linear.flight, linear.theta, driven))
    path = path + 0.3 * np.random.default_rng(0).standard_normal(path.shape)
    made = linearise(linear.flight, linear.theta, driven._replace(path=path))
    return made, filter_gains(linear.flight, linear.hyper, made)


def test_a_linear_flight_has_none(linear, along):
    """So its innovations stay as they are."""
    lin, made = along
    found, lost = mean_correction.mean(linear.flight, linear.hyper, made, linear.theta, lin)
    assert lost == 0
    assert found.outputs.shape == np.shape(linear.flight.observed) and found.inputs.shape == np.shape(
        lin.latent_path.path
    )
    for part in found:
        np.testing.assert_allclose(part, 0.0, atol=1e-9)
    seen = as_seen(lin)
    np.testing.assert_allclose(innovations(made, *seen.less(found)), innovations(made, *seen), atol=1e-8)


def test_flights_that_all_fail_are_refused(linear, along):
    lin, made = along
    spoiled = replace(linear.flight, observed=np.full(np.shape(linear.flight.observed), np.nan))
    with pytest.raises(FloatingPointError, match="drawn disturbances"):
        mean_correction.mean(spoiled, linear.hyper, made, linear.theta, lin)


def test_the_slope_is_that_of_half_the_squared_innovations(linear, along):
    lin, made = along
    rng = np.random.default_rng(3)
    outputs = np.where(linear.flight.present, rng.standard_normal(np.shape(linear.flight.observed)), 0.0)
    shift, none = (
        MeanCorrection(outputs, rng.standard_normal(np.shape(lin.latent_path.path))),
        MeanCorrection(*2 * [0.0]),
    )
    seen = as_seen(lin)

    def cost(theta, by):
        series, driven = (part[..., 0] - part[..., 1:] @ theta for part in seen)
        unit = innovations(made, (series - by.outputs)[..., None], (driven + by.inputs)[..., None])
        return 0.5 * float(np.sum(np.square(unit)))

    told = mean_correction.slope(lin, made, shift)
    for i, axis in enumerate(np.eye(linear.theta.size)):
        by_gap = [cost(s * axis, shift) - cost(s * axis, none) for s in (1e-3, -1e-3)]
        assert float(told[i]) == pytest.approx((by_gap[0] - by_gap[1]) / 2e-3, rel=1e-5, abs=1e-7)


@pytest.fixture(scope="module")
def square(bent):
    """The flight bent by a square at its conditional optimum, and its filter there."""
    flight, hyper, priors = bent
    held = [replace(priors[0], scale=1e-6)]
    theta = np.array([1.0])
    (at,) = fit([flight], hyper, held, theta, tolerance=1e-6).flights
    return flight, hyper, theta, at, filter_gains(flight, hyper, linearise(flight, theta, at.latent_path(flight)))


def _law(flight, hyper, at, dense):
    """Covariance of start and disturbances given the data of the flight linearised at a point, by dense matrices."""
    middle = 0.5 * (np.asarray(at.error)[:-1, 0] + np.asarray(at.error)[1:, 0])
    prior = np.eye(6)
    prior[1:, 1:] = dense.disturbance_covariance(flight.latent, hyper.disturbance_parameters, flight.dt * np.arange(5))
    x, rows = np.eye(6)[0] * flight.start_scale[0], []
    for t in range(5):
        if t:
            x = 0.8 * x + (1.0 + 0.4 * middle[t - 1]) * 0.5 * (np.eye(6)[t] + np.eye(6)[t + 1])
        rows.append(x)
    by = np.array(rows)
    noise = (np.asarray(a) for a in (hyper.noise.white, hyper.noise.correlated, hyper.noise.time_constant))
    r = dense.noise_covariance(flight.dt * np.arange(5), flight.present, *noise)
    gain = prior @ by.T @ np.linalg.inv(by @ prior @ by.T + r)
    return prior - gain @ by @ prior


def test_the_gap_of_a_square_is_that_of_its_dense_conditional_law(square, dense, monkeypatch):
    """A step has the square of a disturbance, so its mean leads ahead by a fifth of the variance; outputs don't bend."""
    flight, hyper, theta, at, made = square
    covariance = _law(flight, hyper, at, dense)
    pair = 0.5 * (np.eye(6)[1:5] + np.eye(6)[2:6])
    wanted = 0.2 * np.einsum("ti,ij,tj->t", pair, covariance, pair)
    assert wanted.min() > 0.01
    few, _ = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    monkeypatch.setattr(mean_correction, "_PAIRS", 20_000)
    many, lost = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    assert lost == 0
    for found, close in ((few, 5.0 * np.sqrt(2.0 / 32)), (many, 5.0 * np.sqrt(2.0 / 20_000))):
        np.testing.assert_allclose(found.inputs[1:, 0], wanted, rtol=close)
        np.testing.assert_allclose(found.inputs[0], 0.0, atol=1e-12)
        np.testing.assert_allclose(found.outputs, 0.0, atol=1e-12)


@pytest.mark.parametrize(("failing", "narrower"), [(10, False), (20, True)])
def test_a_pair_is_left_out_only_at_the_samples_where_it_fails(square, monkeypatch, failing, narrower):
    """At sample 3 some pairs of 32 fail at full width: the others keep all, or all are drawn at half the width."""
    flight, hyper, theta, at, made = square
    path, sound, calls = at.latent_path(flight), mean_correction.stepped, []
    lin = linearise(flight, theta, path)
    whole, _ = mean_correction.mean(flight, hyper, made, theta, lin)

    def failed(data, theta, latent_path):
        residual, defects = (np.array(a) for a in sound(data, theta, latent_path))
        if residual.ndim == 3:
            both = defects - np.asarray(sound(data, theta[:, 0], path)[1])[..., None]
            calls.append(0.5 * (both[3, 0, :failing] + both[3, 0, 32 : 32 + failing]).mean())
            if len(calls) == 1:
                residual[3, :, :failing] = np.nan
        return residual, defects

    monkeypatch.setattr(mean_correction, "stepped", failed)
    found, lost = mean_correction.mean(flight, hyper, made, theta, lin)
    assert lost == failing and len(calls) == 1 + narrower
    if narrower:
        return
    others = np.arange(flight.samples) != 3
    np.testing.assert_allclose(found.inputs[others], whole.inputs[others], rtol=1e-12)
    lacking = (32 * whole.inputs[3, 0] - (32 - failing) * found.inputs[3, 0]) / failing
    assert lacking == pytest.approx(calls[0], rel=1e-6)


def test_the_gap_is_the_mean_of_steps_over_many_draws(descent, dense, monkeypatch):
    """Of a descent in strong gusts, whose drag goes with a square: against plain means over draws of dense matrices."""
    flight, theta = descent.flights[0], descent.theta
    hyper = replace(descent.hyper, disturbance_parameters=(np.array([2.0, 3.0]),))
    held = [replace(descent.priors[0], centre=theta[0], scale=1e-6)]
    (at,) = fit([flight], hyper, held, theta, tolerance=1e-6).flights
    lin = linearise(flight, theta, at.latent_path(flight))
    monkeypatch.setattr(mean_correction, "_PAIRS", 2000)
    found, _ = mean_correction.mean(flight, hyper, filter_gains(flight, hyper, lin), theta, lin)
    by = _responses(flight, hyper, lin)
    outputs = dense.stack(np.einsum("tcx,txk->tck", lin.steps.out_state, by), flight.present)
    noise = jax.tree.map(np.asarray, hyper.outputs(flight))
    times = flight.dt * np.arange(flight.samples)
    r = dense.noise_covariance(times, flight.present, noise.white, noise.correlated, noise.time_constant)
    law = np.linalg.inv(np.eye(outputs.shape[1]) + outputs.T @ np.linalg.solve(r, outputs))
    z = np.linalg.cholesky(law) @ np.random.default_rng(5).standard_normal((len(law), 2000))
    z = np.concatenate([z, -z, np.zeros((len(z), 1))], axis=1)
    path = np.asarray(at.path)[..., None] + np.einsum("txk,kb->txb", by, z)
    error = np.asarray(at.error)[..., None] + _errors(flight, hyper, z[1:])
    ends = np.array(_stepped(flight, np.repeat(theta[:, None], z.shape[1], axis=1), path, error))
    wanted = ends[..., :-1].mean(axis=-1) - ends[..., -1]
    told, size = np.asarray(found.inputs)[1:], np.abs(wanted).max(axis=0)
    assert size[1] > 1e-3  # of the descent rate [m/s]
    np.testing.assert_allclose(told / size, wanted / size, atol=0.2)
    np.testing.assert_allclose(told.sum(axis=0), wanted.sum(axis=0), rtol=0.05)
    np.testing.assert_allclose(found.outputs, 0.0, atol=1e-12)


def _errors(flight, hyper, z):
    """Disturbances (T, 1, B) of process noise (T, B)."""
    return np.asarray(disturbances.disturbances(hyper.dynamics(flight), jnp.asarray(z)[:, None]))


def _responses(flight, hyper, lin):
    """States (T, X, 1 + T) by standard start and process noise, linearly, one sample after the other."""
    steps, count = lin.steps, 1 + flight.samples
    error = np.concatenate([np.zeros((flight.samples, 1, 1)), _errors(flight, hyper, np.eye(flight.samples))], axis=2)
    rows = [np.asarray(steps.first_start) * flight.start_scale @ np.eye(count)[:1]]
    for t in range(flight.samples - 1):
        rows.append(steps.by_state[t] @ rows[-1] + steps.by_now[t] @ error[t] + steps.by_then[t] @ error[t + 1])
    return np.array(rows)


def _stepped(flight, theta, path, error):
    """Where every step leads (T - 1, X, B), one after the other."""
    model, numbers = flight.model, flight.model.numbers(jnp.asarray(theta))
    inputs = [jax.tree.map(lambda a, t=t: jnp.asarray(a)[t], model.inputs()) for t in range(len(path))]
    rows = zip(path[:-1], inputs[:-1], inputs[1:], error[:-1], error[1:], strict=True)
    advance = jax.jit(lambda x, now, then, e0, e1: model.advance(x, numbers, now, then, e0, e1))
    return [advance(*row) for row in rows]


def test_where_no_pair_flies_narrower_ones_tell_the_same(square, monkeypatch):
    """Of a flight bent by a square the second order is all there is, so a quarter of the width tells it exactly."""
    flight, hyper, theta, at, made = square
    wanted, lost = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    assert lost == 0 and np.abs(wanted.inputs).max() > 0.01
    widths, real = [], mean_correction.stepped

    def narrow(flight, theta, driven):
        residual, defects = (np.array(a) for a in real(flight, theta, driven))
        if defects.ndim == 3:
            widths.append(float(np.abs(np.asarray(driven.error) - np.asarray(at.error)[..., None]).max()))
            if len(widths) < 3:
                defects[3:] = np.nan
        return residual, defects

    monkeypatch.setattr(mean_correction, "stepped", narrow)
    found, lost = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    assert len(widths) == 3 and widths[2] == pytest.approx(0.25 * widths[0]) and lost == 32
    for part, want in zip(found, wanted, strict=True):
        np.testing.assert_allclose(part, want, rtol=1e-9, atol=1e-12)


def test_few_pairs_close_together_tell_the_same_as_wide_ones_of_them(square, monkeypatch):
    """What they tell of a flight bent by a square is exact, so only their number matters."""
    flight, hyper, theta, at, made = square
    lin = linearise(flight, theta, at.latent_path(flight))
    few, _ = mean_correction.mean(flight, hyper, made, theta, lin, rough=True)
    monkeypatch.setattr(mean_correction, "_FEW", mean_correction._PAIRS)
    many, _ = mean_correction.mean(flight, hyper, made, theta, lin, rough=True)
    wanted, _ = mean_correction.mean(flight, hyper, made, theta, lin)
    np.testing.assert_allclose(many.inputs, wanted.inputs, rtol=1e-6, atol=1e-12)
    assert np.abs(few.inputs - wanted.inputs).max() > 1e-3


def test_a_pair_that_leads_beyond_all_states_of_the_draws_is_left_out(square, monkeypatch):
    """As one beyond an edge of what the model can fly; it is finite all the same."""
    flight, hyper, theta, at, made = square
    real = mean_correction.stepped

    def far(flight, theta, driven):
        residual, defects = (np.array(a) for a in real(flight, theta, driven))
        if defects.ndim == 3:
            defects[2, :, 7] += 1e3
        return residual, defects

    monkeypatch.setattr(mean_correction, "stepped", far)
    found, lost = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    assert lost == 1 and np.abs(found.inputs).max() < 0.1


def test_a_pair_that_fails_is_left_out_and_counted(square, monkeypatch):
    flight, hyper, theta, at, made = square
    real = mean_correction.stepped

    def lost_one(flight, theta, driven):
        residual, defects = (np.array(a) for a in real(flight, theta, driven))
        if defects.ndim == 3:
            defects[2, :, 5] = np.inf
        return residual, defects

    whole, _ = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    monkeypatch.setattr(mean_correction, "stepped", lost_one)
    found, lost = mean_correction.mean(flight, hyper, made, theta, linearise(flight, theta, at.latent_path(flight)))
    assert lost == 1 and np.isfinite(found.inputs).all()
    off = np.abs(np.asarray(found.inputs) - np.asarray(whole.inputs))
    assert 0.0 < off.max() < 0.3 * np.abs(whole.inputs).max()


def test_elsewhere_it_has_the_change_of_few_pairs(square):
    """At another parameter of a flight whose steps bend as they did it is what it was."""
    flight, hyper, theta, at, made = square
    lin = linearise(flight, theta, at.latent_path(flight))
    here, _ = mean_correction.mean(flight, hyper, made, theta, lin)
    rough, _ = mean_correction.mean(flight, hyper, made, theta, lin, rough=True)
    off = MeanCorrection(rough.outputs - 0.01, rough.inputs - 0.02)
    same, aside = (mean_correction.elsewhere(flight, hyper, made, theta, lin, here, one) for one in (rough, off))
    for part, want, more in zip(same, here, (0.01, 0.02), strict=True):
        np.testing.assert_allclose(part, want, atol=1e-15)
        np.testing.assert_allclose(aside[more == 0.02], want + more, atol=1e-12)


def test_where_it_is_not_of_second_order_all_pairs_tell_it_at_full_width(square, monkeypatch):
    """A step with a kink deviates in proportion to a pair's width: continued as a square that is several times too much."""
    flight, hyper, theta, at, made = square
    lin = linearise(flight, theta, at.latent_path(flight))
    known = [mean_correction.mean(flight, hyper, made, theta, lin, rough=rough)[0] for rough in (False, True)]
    real = mean_correction.stepped

    def kinked(flight, theta, driven):
        residual, defects = (np.array(a) for a in real(flight, theta, driven))
        if defects.ndim == 3:
            away = np.asarray(driven.error)[2, 0] - np.asarray(at.error)[2, 0]
            defects[2] += 0.4 * np.abs(away)
        return residual, defects

    monkeypatch.setattr(mean_correction, "stepped", kinked)
    wide, _ = mean_correction.mean(flight, hyper, made, theta, lin)
    close, _ = mean_correction.mean(flight, hyper, made, theta, lin, rough=True)
    assert close.inputs[2, 0] > 3.0 * wide.inputs[2, 0] > 0.0
    found = mean_correction.elsewhere(flight, hyper, made, theta, lin, *known)
    for part, want in zip(found, wide, strict=True):
        np.testing.assert_array_equal(part, want)
