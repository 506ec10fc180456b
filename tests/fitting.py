"""Two small flights for all tests of inference: a descent, and a linear system whose every answer is a matrix formula."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import ModuleType, SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.dynamics.descent import DensityProfile, DescentFlight, DescentInputs
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData, Lifted, NoiseParameters, Unknowns, latent_path_of, residuals, states
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.likelihood.simulation_smoother import Normals
from bayeschute.posterior.beyond_linear import laplace, polynomials
from bayeschute.posterior.fit.joint_fit import joint_fit
from bayeschute.posterior.fit.laplace_fit import find
from bayeschute.posterior.joint_mode import fit
from bayeschute.posterior.marginal import Quadratic, marginalise, shifted
from bayeschute.posterior.noise_evidence import NoisePrior
from tests.twins import dense_noise as _dense
from tests.twins import quadrature as _quadrature

GUSTS = Latent(("drift",), ((0, 0),))
MIXED = Latent(("drift", "oscillator"), ((0, 0), (1, 0), (1, 1)))  # a law shared, and two processes in one row


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearFlight:
    """A `FlightModel` that is linear in everything: two states, two outputs, two parameters, two disturbances."""

    drive: Any
    stepping: Stepping = field(default=Stepping(1), metadata={"static": True})

    def inputs(self):
        return self.drive

    def numbers(self, theta):
        return theta

    def initial(self, numbers, start):
        return jnp.stack([1.0 + start[0], -0.5 + start[1] + 0.3 * numbers[0]])

    def advance(self, x, numbers, now, then, error_now, error_then):
        e = 0.5 * (error_now + error_then)
        first = 0.95 * x[0] + 0.20 * x[1] + 0.1 * e[0] + 0.05 * now * numbers[1]
        second = -0.20 * x[0] + 0.90 * x[1] + 0.1 * e[1] + 0.02 * (now + then) + 0.05 * numbers[0]
        return jnp.stack([first, second])

    def observe(self, x, numbers, now):
        return jnp.stack([x[0] + 0.5 * x[1] + 0.2 * numbers[1] * now, x[1]])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BentFlight:
    """A `FlightModel` whose disturbance enters with its square as well: its mean is not the flight of the mean."""

    drive: Any
    stepping: Stepping = field(default=Stepping(1), metadata={"static": True})

    def inputs(self):
        return self.drive

    def numbers(self, theta):
        return theta

    def initial(self, numbers, start):
        return start

    def advance(self, x, numbers, now, then, error_now, error_then):
        e = 0.5 * (error_now + error_then)
        return 0.8 * x + 0.3 * numbers + e + 0.2 * e**2

    def observe(self, x, numbers, now):
        return x


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FeltFlight(BentFlight):
    """One whose parameter tells how strongly its disturbance is felt."""

    def advance(self, x, numbers, now, then, error_now, error_then):
        return 0.8 * x + 0.5 * numbers * (1.0 + error_now + error_then)


def simulate(flight, hyper, theta, seed, gaps=0.1):
    """The flight with data drawn from its own law, and the unknowns that made them."""
    rng = np.random.default_rng(seed)
    nothing = np.zeros_like(flight.observed)
    flight = replace(flight, observed=nothing, present=nothing == 0.0)
    u = Unknowns(rng.standard_normal(flight.starts), rng.standard_normal((flight.samples, flight.latent.size)))
    clean = -np.asarray(residuals(flight, jnp.asarray(theta), latent_path_of(flight, hyper, u)))
    noise = jax.tree.map(np.asarray, hyper.outputs(flight))
    times = flight.dt * np.arange(flight.samples)
    covariance = _dense.noise_covariance(times, flight.present, noise.white, noise.correlated, noise.time_constant)
    drawn = np.linalg.cholesky(covariance) @ rng.standard_normal(len(covariance))
    observed = clean + drawn.reshape(clean.shape[::-1]).T
    present = rng.random(observed.shape) > gaps
    present[10:14] = False
    return replace(flight, observed=np.where(present, observed, 0.0), present=present), u


@pytest.fixture(scope="session")
def flown():
    """A flight on the path of its own simulation, of a flight, its noise parameters, parameters and unknowns."""

    def made(data, hyper, theta, unknowns):
        driven = latent_path_of(data, hyper, unknowns)
        return Lifted(unknowns, driven.error, states(data, jnp.asarray(theta), driven))

    return made


@pytest.fixture(scope="session")
def dense():
    """Dense Gaussian twins."""
    return _dense


@pytest.fixture(scope="session")
def quadrature():
    """Integrals over start and process noise by brute force."""
    return _quadrature


@pytest.fixture(scope="session")
def descent():
    """A descent of 50 s at 2 Hz under wind error and noise, twice, with its truth."""
    air = DensityProfile(0.0, 500.0, np.log(1.225) - 500.0 * np.arange(8) / 9000.0)
    model = DescentFlight(air, DescentInputs(np.zeros(101)), 2500.0, 10.0, 0.5, Stepping(2))
    nothing = np.zeros((101, 1))
    empty = FlightData(model, nothing, nothing == 0.0, 0.5, np.array([2.0]), (0,), GUSTS)
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.05, 0.10, 2.0))), (np.array([0.4, 12.0]),))
    theta = np.array([np.log(0.2)])
    made = [simulate(empty, hyper, theta, seed) for seed in (1, 2)]
    priors = [Prior("cds_over_mass", float(np.log(0.22)), 0.3, True, "m^2/kg", "a guess")]
    return SimpleNamespace(
        flights=[f for f, _ in made], u=[u for _, u in made], hyper=hyper, theta=theta, priors=priors, simulate=simulate
    )


@pytest.fixture(scope="session")
def short(descent):
    """Five samples of a descent in strong gusts, seen sharply: its determinant depends on the drag."""
    flight, rng = descent.flights[0], np.random.default_rng(0)
    model = replace(flight.model, record=DescentInputs(np.zeros(5)))
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.05, 0.05, 2.0))), (np.array([1.0, 3.0]),))
    empty = replace(flight, model=model, observed=np.zeros((5, 1)), present=np.ones((5, 1), bool))
    u = Unknowns(rng.standard_normal(1), rng.standard_normal((5, 1)))
    from_truth = -np.asarray(residuals(empty, descent.theta, latent_path_of(empty, hyper, u)))
    observed = from_truth + 0.05 * rng.standard_normal((5, 1))
    return replace(empty, observed=observed), hyper, [replace(descent.priors[0], centre=np.log(0.2))]


@pytest.fixture(scope="session")
def bent(descent):
    """Five samples of a bent flight in gusts of which the data tell little."""
    rng, priors = np.random.default_rng(3), [Prior("drive", 1.0, 2.0, False, "1", "test")]
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.3, 0.3, 2.0))), (np.array([0.8, 3.0]),))
    model, present = BentFlight(np.zeros(5)), np.ones((5, 1), bool)
    flight = replace(
        descent.flights[0], model=model, observed=np.zeros((5, 1)), present=present, start_scale=np.array([0.2])
    )
    u = Unknowns(rng.standard_normal(1), rng.standard_normal((5, 1)))
    seen = -np.asarray(residuals(flight, np.array([1.0]), latent_path_of(flight, hyper, u)))
    flight = replace(flight, observed=seen + 0.3 * rng.standard_normal((5, 1)))
    return flight, hyper, priors


@pytest.fixture(scope="session")
def felt_flight():
    """The class of flights whose parameter tells how strongly a disturbance is felt."""
    return FeltFlight


@pytest.fixture(scope="session")
def settled(descent):
    """The joint optimum of the descent from its prior means."""
    return joint_fit(descent.flights, descent.priors, NoisePrior(descent.hyper))


@pytest.fixture(scope="session")
def found(descent):
    """The marginal posterior of the falling bodies."""
    return find(descent.flights, descent.priors, NoisePrior(descent.hyper, 0.4), rounds=1)


@pytest.fixture(scope="session")
def linear(dense):
    """The linear flight with its truth, and its matrices in plain NumPy."""
    samples, dt = 60, 0.2
    model, nothing = LinearFlight(np.sin(0.4 * np.arange(samples))), np.zeros((samples, 2))
    empty = FlightData(model, nothing, nothing == 0.0, dt, np.array([0.5, 0.4]), (1, 0), MIXED)
    noise = Noise(np.array([0.04, 0.06]), np.array([0.10, 0.05]), np.array([0.9, 2.0]))
    hyper = NoiseParameters(noise, (np.array([0.6, 2.5]), np.array([0.9, 0.35, 0.15])))
    theta = np.array([0.7, -0.4])
    priors = [Prior("one", 0.5, 0.6, False, "1", ""), Prior("two", 0.0, 0.8, False, "1", "")]
    flight, u = simulate(empty, hyper, theta, 3)
    names = ("theta", "u", "flight", "hyper", "priors")
    return SimpleNamespace(
        **dict(zip(names, (theta, u, flight, hyper, priors), strict=True)),
        matrices=_Matrices(dense),
        simulate=simulate,
    )


def optimal_marginal(flights, case, theta):
    """The marginal posterior at the joint optimum, its determinant held constant."""
    best = fit(flights, case.hyper, case.priors, theta, tolerance=1e-4)
    return marginalise(flights, case.hyper, case.priors, best)


@pytest.fixture(scope="session")
def straight(linear):
    """The marginal posterior of the linear flight."""
    return optimal_marginal([linear.flight], linear, np.zeros(2))


@pytest.fixture(scope="session")
def falling(descent):
    """The marginal posterior of two descents with one parameter, with what its linear models lack."""
    return polynomials.corrected(optimal_marginal(descent.flights, descent, descent.theta))[0]


@pytest.fixture(scope="session")
def gusty(descent, felt_flight):
    """A flight whose parameter tells how strongly a gust is felt, and its marginal posterior before and after."""
    priors = [Prior("felt", 1.0, 1.0, False, "1", "test")]
    hyper = NoiseParameters(Noise(*(np.array([x]) for x in (0.2, 0.2, 2.0))), (np.array([0.5, 3.0]),))
    nothing = np.zeros((100, 1))
    empty = replace(
        descent.flights[0], model=felt_flight(nothing[:, 0]), observed=nothing, present=nothing == 0.0, start_scale=np.array([0.2])
    )  # fmt: skip
    flight, _ = descent.simulate(empty, hyper, np.array([1.0]), 4)
    made = marginalise([flight], hyper, priors, fit([flight], hyper, priors, np.array([1.0]), tolerance=1e-4))
    return flight, hyper, priors, made, polynomials.corrected(made)[0]


def plain(marginal):
    """The posterior without its corrections."""
    none = Quadratic.none(np.size(marginal.centre))
    along = [one._replace(aside=jax.tree.map(np.zeros_like, one.aside)) for one in marginal.along]
    return replace(marginal, determinant=none, bend=none, along=tuple(along))


def minus_log_density(marginal, xi):
    made = laplace.at(marginal, xi)
    return made.square + made.determinant


def limited(monkeypatch, least, most):
    """Flights fail outside these standard coordinates."""

    def some(marginal, xi):
        theta, shift = shifted(marginal, xi)
        flies = (np.asarray(xi) >= least).all() and (np.asarray(xi) <= most).all()
        return (theta if flies else np.nan * theta), shift

    monkeypatch.setattr(laplace, "shifted", some)


class _Matrices:
    """Everything about a linear flight from dense matrices; u is its standard start, then its disturbances (T, 2)."""

    def __init__(self, dense):
        self.dense = dense

    def model(self, flight):
        """Stacked data y, prediction at zero and Jacobian by (theta, u): y ~ zero + by @ (theta, u)."""
        drive = flight.model.drive
        size = 2 + 2 + 2 * len(drive)
        x = np.concatenate([np.zeros((size, 1)), np.eye(size)], axis=1)
        theta, start, error = x[:2], flight.start_scale[:, None] * x[2:4], x[4:].reshape(len(drive), 2, -1)
        state, rows = np.stack([1.0 + start[0], -0.5 + start[1] + 0.3 * theta[0]]), []
        for t in range(len(drive)):
            if t:
                e, now, then = 0.5 * (error[t - 1] + error[t]), drive[t - 1], drive[t]
                known = np.stack([0.05 * now * theta[1], 0.02 * (now + then) + 0.05 * theta[0]])
                state = np.array([[0.95, 0.2], [-0.2, 0.9]]) @ state + 0.1 * e + known
            rows.append(np.stack([state[0] + 0.5 * state[1] + 0.2 * theta[1] * drive[t], state[1]]))
        out = self.dense.stack(np.array(rows), flight.present)
        return self.dense.stack(flight.observed, flight.present), out[:, 0], out[:, 1:] - out[:, :1]

    def covariances(self, flight, hyper, priors):
        """Covariance of the noise, of u and of theta."""
        noise = [
            np.asarray(a)[list(flight.channel)]
            for a in (hyper.noise.white, hyper.noise.correlated, hyper.noise.time_constant)
        ]
        times = flight.dt * np.arange(len(flight.observed))
        r = self.dense.noise_covariance(times, flight.present, *noise)
        u = np.eye(2 + 2 * times.size)
        u[2:, 2:] = self.dense.disturbance_covariance(flight.latent, hyper.disturbance_parameters, times)
        return r, u, np.diag([p.scale**2 for p in priors])

    def posterior(self, flight, hyper, priors):
        """Mean and covariance of (theta, u)."""
        y, zero, by = self.model(flight)
        r, u, t = self.covariances(flight, hyper, priors)
        prior = np.zeros((len(t) + len(u),) * 2)
        prior[:2, :2], prior[2:, 2:] = t, u
        mean = np.concatenate([[p.centre for p in priors], np.zeros(len(u))])
        total = by @ prior @ by.T + r
        gain = np.linalg.solve(total, by @ prior).T
        covariance = prior - gain @ by @ prior
        return mean + gain @ (y - zero - by @ mean), covariance

    def evidence(self, flight, hyper, priors):
        """Log density of the data, theta and u integrated out."""
        y, zero, by = self.model(flight)
        r, u, t = self.covariances(flight, hyper, priors)
        centre = np.array([p.centre for p in priors])
        total = r + by[:, :2] @ t @ by[:, :2].T + by[:, 2:] @ u @ by[:, 2:].T
        return self.dense.gaussian_log_density(y - zero - by[:, :2] @ centre, total)

    def given_theta(self, flight, hyper, theta):
        """Log density of the data given theta, u integrated out."""
        y, zero, by = self.model(flight)
        r, u, _ = self.covariances(flight, hyper, [])
        return self.dense.gaussian_log_density(y - zero - by[:, :2] @ theta, r + by[:, 2:] @ u @ by[:, 2:].T)


@pytest.fixture(scope="session")
def each_number():
    """Makes the numbers behind draws of a flight: none at all, then each of them alone."""

    def numbers(flight):
        t, c = flight.observed.shape
        shapes = ((flight.starts,), (t, flight.latent.size), (t, c), (t, c))
        sizes = [int(np.prod(s)) for s in shapes]
        eye = np.concatenate([np.zeros((sum(sizes), 1)), np.eye(sum(sizes))], axis=1)
        parts = zip(np.split(eye, np.cumsum(sizes)[:-1]), shapes, strict=True)
        return Normals(*(a.reshape(*s, -1) for a, s in parts))

    return numbers


@pytest.fixture
def fails_beyond(monkeypatch):
    """Makes flights fail, for a module that asks `shifted` for their parameters, beyond so far in standard coordinates."""

    def set_up(module: ModuleType, most: float) -> None:
        def some(marginal, xi):
            theta, shift = shifted(marginal, xi)
            return (theta if (np.abs(xi) <= most).all() else np.nan * theta), shift

        monkeypatch.setattr(module, "shifted", some)

    return set_up
