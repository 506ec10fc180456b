"""Marginal posterior of the parameters: initial state and latent disturbances integrated out by Laplace's method.

At a point theta_0 the flight is linearised along its conditional mode, a trajectory with its start and disturbances.
For another theta that trajectory is followed linearly, every step and output is evaluated there once with the full
equations of motion, and the remainder is integrated as a Gaussian: the filter of the linear model turns residuals and
continuity defects into innovations, ``log density = -1/2 |innovations|^2 - rest`` (METHODS 6). Steps are corrected by
the data one by one, so that the likelihood of an unstable flight is well-behaved. The errors of the linear model, whose
derivatives are those at theta_0, are corrected by polynomials: the log determinant, which moves parameters by several
standard errors, and the curvature of the exact conditional mode (`posterior.beyond_linear`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from bayeschute.core.array_library import library_of
from bayeschute.core.numerics import processors
from bayeschute.core.vectors import Component
from bayeschute.likelihood import mean_correction
from bayeschute.likelihood.joint import (
    FlightData,
    LatentPath,
    Lifted,
    Linear,
    NoiseParameters,
    Unknowns,
    as_seen,
    disturbed,
    filter_gains,
    latent_path_of,
    moved,
    stepped,
)
from bayeschute.likelihood.kalman import Gains, MeanCorrection, Seen, innovations
from bayeschute.likelihood.priors import Prior, factor, working
from bayeschute.likelihood.simulation_smoother import Normals, drawn
from bayeschute.posterior.along_record.conditional_mode import brought
from bayeschute.posterior.joint_mode import Optimum, conditional

Array = NDArray[np.float64]
_CORRECTIONS, _MOST_CORRECTED = 1, 0.5
_BENT, _STEEPER, _ROUNDING = 0.05, 0.05, 1e-3  # see `twice_price`
_DEAR = 20.0  # price of a place, in log density, beyond which the linear models say nothing of it
_NO_CHANGE = 1e-9  # share of a parameter's standard deviation
_REACH = 4.0  # standard coordinates beyond the usual distance of draws up to which polynomials are followed
BATCH = 64


class Linearisation(NamedTuple):
    """A flight about the conditional optimum of its path.

    Derivatives are by the K of all P parameters that move the flight (`parameters`), last axis.

    Attributes:
        theta: theta_0 (P,).
        at: The optimum there.
        slope: Its derivatives in the linear model.
        aside: Difference of these from the derivatives of the exact conditional mode.
        known: Linear contribution of start and disturbances to every step at theta_0 (T, X).
        known_slope: Its derivatives (T, X, K).
        mean_correction: Mean of steps and outputs over start and disturbances given theta_0, minus those at the mode.
        rough: The same of few paths, for its change with theta.
        lost: Number of pairs of the mean correction that failed.
        linear: The flight linearised there.
        gains: The filter.
        unit: Innovations at theta_0, and minus their derivatives (T, C, 1 + K).
    """

    theta: Component
    at: Lifted
    slope: Lifted
    aside: Lifted
    known: Component
    known_slope: Component
    mean_correction: MeanCorrection
    rough: MeanCorrection
    lost: int
    linear: Linear
    gains: Gains
    unit: Component

    @property
    def parameters(self) -> Component:
        """Numbers of the parameters that move the flight (K,)."""
        return self.linear.parameters


class Quadratic(NamedTuple):
    """``slope xi + 1/2 xi' curvature xi`` of standard coordinates: (P,) and a symmetric matrix (P, P)."""

    slope: Component
    curvature: Component

    @classmethod
    def none(cls, parameters: int) -> Quadratic:
        """Zero."""
        return cls(np.zeros(parameters), np.zeros((parameters, parameters)))

    def at(self, xi: Component) -> Component:
        """Values (...) at (P, ...)."""
        library = library_of(self, xi)
        bent = library.tensordot(self.curvature, xi, axes=1)
        return library.tensordot(self.slope, xi, axes=1) + 0.5 * library.sum(xi * bent, axis=0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Marginal:
    """The marginal posterior; `scale` maps standard coordinates xi to theta: ``theta = centre + scale @ xi``.

    Attributes:
        flights: Records.
        hyper: Noise parameters, fixed.
        along: Start and disturbances given theta, one entry per flight.
        centre: Where the flights were linearised (P,).
        scale: Lower Cholesky factor of the Laplace covariance of theta (P, P).
        prior_centre: Prior means of theta (P,).
        prior_factor: Lower Cholesky factor of its prior covariance (P, P).
        determinant: Log determinant of all flights together, less its value at theta_0.
        bend: Difference of the curvature of minus the log density at the exact conditional modes from the linear
            models'.
    """

    flights: tuple[FlightData, ...]
    hyper: NoiseParameters
    along: tuple[Linearisation, ...]
    centre: Component
    scale: Component
    prior_centre: Component
    prior_factor: Component
    determinant: Quadratic
    bend: Quadratic

    @property
    def correction(self) -> Quadratic:
        """Minus the log density less the squares of `projected_residuals`."""
        return Quadratic(*(a + b for a, b in zip(self.determinant, self.bend, strict=True)))

    @cached_property
    def felt(self) -> NDArray[np.bool_]:
        """Whether a standard coordinate moves a flight (F, P): changes a parameter that its innovations tell of.

        Constant errors of a record are parameters of its flight alone. They stand behind what flights share, and given
        that they are independent from flight to flight, so the Cholesky factor gives them coordinates of their own.
        """
        scale = np.abs(np.asarray(self.scale))
        changes = scale > _NO_CHANGE * np.linalg.norm(scale, axis=1, keepdims=True)
        told = [along.parameters[np.any(np.asarray(along.unit)[..., 1:], axis=(0, 1))] for along in self.along]
        return np.array([changes[parameters].any(axis=0) for parameters in told])

    def theta(self, xi: Component) -> Component:
        """Parameters (P, ...) of standard coordinates (P, ...)."""
        return shifted(self, xi)[0]

    def correction_at(self, xi: Component) -> Component:
        """`correction` (...) at standard coordinates (P, ...): see `followed`."""
        return self.correction.at(self.followed(xi))

    def followed(self, xi: Component) -> Component:
        """Standard coordinates (P, ...) at which `correction` is taken: beyond its reach it does not fall any more.

        It is told from places one standard deviation off and from draws, whose distance from the mode is about the root
        of P. Where it falls farther off the density would rise without bound: of a flight whose posterior no surrogate
        could propose for (independent set small-13) a walk came to rest 500 standard deviations away. So it is not less
        there than at the end of its reach on the same ray. Where it grows it is followed: it may be all that keeps a
        walk from places where linear models fit too well.
        """
        library, reach = library_of(xi), _REACH + np.sqrt(np.shape(xi)[0])
        square = library.sum(xi**2, axis=0)
        far = square > reach**2
        end = xi * library.where(far, reach / library.sqrt(library.maximum(square, reach**2)), 1.0)
        return library.where(far & (self.correction.at(xi) < self.correction.at(end)), end, xi)


def _about(flight: FlightData, hyper: NoiseParameters, linear: Linear) -> tuple[Lifted, Component, Gains]:
    """Derivatives of the conditional optimum, those of `Linearisation.known`, and the filter."""
    given = conditional(flight, hyper, linear)
    by_theta = jax.tree.map(np.negative, given.slope)
    slope = Lifted(by_theta, latent_path_of(flight, hyper, by_theta).error, -given.states[..., 1:])
    known = disturbed(linear.steps, slope.latent_path(flight, 1))
    return slope, known, given.gains


def _along(flight: FlightData, hyper: NoiseParameters, theta: Array, at: Lifted, linear: Linear) -> Linearisation:
    """A flight about its conditional optimum."""
    slope, known_slope, made = _about(flight, hyper, linear)
    aside = jax.tree.map(lambda a: np.zeros(np.shape(a)), slope)
    mean, lost = mean_correction.mean(flight, hyper, made, theta, linear)
    rough, _ = mean_correction.mean(flight, hyper, made, theta, linear, rough=True)
    known = disturbed(linear.steps, linear.latent_path)
    unit = innovations(made, *as_seen(linear).less(mean))
    return Linearisation(theta, at, slope, aside, known, known_slope, mean, rough, lost, linear, made, unit)


def marginalise(
    flights: Sequence[FlightData], hyper: NoiseParameters, priors: Sequence[Prior], optimum: Optimum
) -> Marginal:
    """Set the marginal posterior up at an optimum, with a constant determinant."""
    places = brought(flights, hyper, optimum.theta, optimum.flights)
    along = tuple(_along(flight, hyper, optimum.theta, *place) for flight, place in zip(flights, places, strict=True))
    flat, root = Quadratic.none(len(priors)), np.linalg.cholesky(optimum.covariance)
    return Marginal(tuple(flights), hyper, along, optimum.theta, root, working(priors)[0], factor(priors), flat, flat)


def mean_correction_slope(marginal: Marginal) -> Array:
    """Contribution of the mean correction to the gradient of minus the log density at theta_0, by theta (P,)."""
    total: Array = np.zeros(np.size(marginal.centre))
    for along in marginal.along:
        total[along.parameters] += np.asarray(mean_correction.slope(along.linear, along.gains, along.mean_correction))
    return total


def place_at(flight: FlightData, along: Linearisation, shift: Component) -> Lifted:
    """Start, process noise and trajectory at ``theta_0 + shift`` (P, ...), followed linearly."""
    library, many = library_of(along.theta, shift), (1,) * (np.ndim(shift) - 1)
    own = shift[along.parameters]
    by = jax.tree.map(lambda a: library.tensordot(a, own, axes=1), along.slope)
    at = jax.tree.map(lambda a: library.reshape(a, (*np.shape(a), *many)), along.at)
    unknowns, error = jax.tree.map(library.add, (at.unknowns, at.error), (by.unknowns, by.error))
    path = library.broadcast_to(at.path, by.path.shape)
    return Lifted(unknowns, error, moved(flight, path, by.path, library.reshape(along.theta, (-1, *many)), shift))


def latent_path_at(flight: FlightData, along: Linearisation, shift: Component) -> LatentPath:
    """Likewise, as a latent path."""
    return place_at(flight, along, shift).latent_path(flight, np.ndim(shift) - 1)


def shifted(marginal: Marginal, xi: Component) -> tuple[Component, Component]:
    """Parameters at standard coordinates (P, ...), and their difference from the centre."""
    library = library_of(marginal.centre, xi)
    middle = library.reshape(marginal.centre, (-1, *(1,) * (np.ndim(xi) - 1)))
    theta = middle + library.tensordot(marginal.scale, xi, axes=1)
    return theta, theta - middle


def seen_along(along: Linearisation, residual: Component, defects: Component, shift: Component) -> Seen:
    """Data of the linear model from residuals (T, C, B) and defects (T, X, B) along `latent_path_at`."""
    inputs = defects - along.known[..., None] - along.known_slope @ shift[along.parameters]
    return Seen(residual - along.mean_correction.outputs[..., None], inputs + along.mean_correction.inputs[..., None])


def _seen(flight: FlightData, along: Linearisation, theta: Component, shift: Component) -> Seen:
    return seen_along(along, *stepped(flight, theta, latent_path_at(flight, along, shift)), shift)


def out_of_range(along: Linearisation, unit: Component, shift: Component, xi: Component) -> Component:
    """Root of twice the price of innovations (T, C, B) that have bent too far (B,).

    They bend with theta, as steps are taken with the full equations. The farther they depart from a straight line, the
    less derivatives taken at theta_0 tell, and far off a linear model about a path that breaks the equations of motion
    may fit better than any flight can. So such places have a price: see `twice_price`.

    Args:
        along: The flight.
        unit: Innovations.
        shift: Parameters less theta_0 (P, B).
        xi: The same in standard coordinates (P, B), those that move the flight (see `Marginal.felt`).
    """
    straight = along.unit[..., 1:] @ shift[along.parameters]
    library = library_of(unit, shift, xi)
    twice = twice_price(library.sum((unit - along.unit[..., :1] + straight) ** 2, axis=(0, 1)), xi)
    return library.where(twice > 0.0, library.sqrt(library.where(twice > 0.0, twice, 1.0)), 0.0)


def twice_price(bent: Component, xi: Component) -> Component:
    """Twice the price (...) of squared departures (...) from a straight line at standard coordinates (P, ...).

    What minus the log density lacks of Laplace's approximation at points of a posterior grows as innovations bend, by
    about the squared departure beyond a twentieth of the squared step. That is the price; far off it grows faster, as
    the squares there may fall by more than a departure's own.
    """
    library = library_of(bent, xi)
    more = library.maximum(bent - _BENT * (library.sum(xi**2, axis=0) + _ROUNDING), 0.0)
    return more * (2.0 + _STEEPER * more)


def flight_residuals(marginal: Marginal, number: int, xi: Component) -> tuple[Array, Array]:
    """Innovations (N, B) of one flight's linear model at standard coordinates (P, B), and what is `out_of_range` (B,).

    Args:
        marginal: The posterior.
        number: Of the flight.
        xi: Standard coordinates (P, B).
    """
    theta, shift = shifted(marginal, xi)
    along = marginal.along[number]
    unit = innovations(along.gains, *_seen(marginal.flights[number], along, theta, shift))
    price = out_of_range(along, unit, shift, xi[marginal.felt[number]])
    return np.reshape(unit, (-1, xi.shape[1])), np.asarray(price)


def prior_residuals(marginal: Marginal, xi: Component) -> Array:
    """Parameters (P, B) under their prior, standardised, at standard coordinates (P, B)."""
    away = np.asarray(shifted(marginal, xi)[0]) - np.asarray(marginal.prior_centre)[:, None]
    return np.asarray(solve_triangular(np.asarray(marginal.prior_factor), away, lower=True))


def prior_lines(marginal: Marginal) -> Array:
    """`prior_residuals` as a linear function of ``(1, xi)``, (P, 1 + P)."""
    away = np.asarray(marginal.centre) - np.asarray(marginal.prior_centre)
    lines = np.column_stack([away, np.asarray(marginal.scale)])
    return np.asarray(solve_triangular(np.asarray(marginal.prior_factor), lines, lower=True))


def linear_residuals(marginal: Marginal, xi: Component) -> tuple[Array, Array]:
    """Residuals of the linear models at standard coordinates (P, B), and the price of what bends.

    Returns:
        (N, B): innovations of every flight, then theta under its prior; (F, B): what is `out_of_range` per flight,
        roots of twice the price.
    """
    rows, prices = zip(*(flight_residuals(marginal, k, xi) for k in range(len(marginal.flights))), strict=True)
    return np.concatenate([*rows, prior_residuals(marginal, xi)]), np.stack(prices)


def in_range(prices: Array) -> NDArray[np.bool_]:
    """Whether the linear models tell anything of places (B,), by `out_of_range` of every flight (F, B)."""
    return np.asarray(np.all(prices < np.sqrt(2.0 * _DEAR), axis=0))


def projected_residuals(marginal: Marginal, xi: Component) -> Array:
    """The vector (N, B) whose ``-1/2 |.|^2`` is the marginal log density at (P, B) but `correction` and a constant."""
    return np.concatenate(linear_residuals(marginal, xi))


def log_density(marginal: Marginal, xi: Component) -> Array:
    """Marginal log density (B,) up to a constant at standard coordinates (P, B); NaN where a step fails."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(-half_squares(marginal, xi) - marginal.correction_at(xi))


def half_squares(marginal: Marginal, xi: Component) -> Array:
    """Half the squares (B,) of `projected_residuals` at (P, B); infinite where the linear models break."""
    with np.errstate(over="ignore"):
        return np.asarray(0.5 * np.sum(projected_residuals(marginal, xi) ** 2, axis=0))


def flight_half_squares(marginal: Marginal, number: int, xi: Component) -> tuple[Array, Array]:
    """Half the squares (B,) of `flight_residuals` and their price at (P, B), and the root of twice the price (B,)."""
    with np.errstate(over="ignore"):
        unit, price = flight_residuals(marginal, number, xi)
        return np.asarray(0.5 * (np.sum(unit**2, axis=0) + price**2)), price


def one_step_errors(marginal: Marginal, xi: Component) -> tuple[Component, ...]:
    """Standardised errors (T, C, B) of predicting every sample from all earlier ones, per flight, at (P, B).

    Zero where nothing was recorded. An output's error is that given the outputs before it in the same sample.
    """
    theta, shift = shifted(marginal, xi)
    pairs = zip(marginal.flights, marginal.along, strict=True)
    return tuple(innovations(a.gains, *_seen(f, a, theta, shift)) for f, a in pairs)


def sample_log_likelihoods(marginal: Marginal, xi: Component) -> tuple[Component, ...]:
    """Log density of every sample given all earlier ones and the parameters, start and disturbances integrated out.

    Its sum over the samples of all flights is `log_density` without the prior, up to a constant. The squared prediction
    errors are each sample's own. What is known of whole flights only is spread evenly over recorded data, so that a
    sample with n recorded outputs gets n shares: `Marginal.correction` over the data of all flights, the price of a
    place out of the linear model's range over those of the flight. (The log determinant's own terms would be no fair
    shares: they depend on the units of the outputs.)

    Args:
        marginal: The posterior.
        xi: Standard coordinates (P, B).

    Returns:
        (T, B) per flight, zero where nothing was recorded.
    """
    _, shift = shifted(marginal, xi)
    each = np.asarray(marginal.correction_at(xi)) / sum(np.sum(flight.present) for flight in marginal.flights)
    rows = zip(marginal.flights, marginal.along, one_step_errors(marginal, xi), marginal.felt, strict=True)
    return tuple(_log_likelihoods(flight, along, unit, shift, xi[felt], each) for flight, along, unit, felt in rows)


def _log_likelihoods(
    flight: FlightData, along: Linearisation, unit: Component, shift: Component, xi: Component, each: Component
) -> Component:
    scale = np.log(np.diagonal(along.gains.root, axis1=1, axis2=2)) + 0.5 * np.log(2.0 * np.pi)
    constant = np.sum(np.where(flight.present, scale, 0.0), axis=1)
    price = 0.5 * out_of_range(along, unit, shift, xi) ** 2 / np.sum(flight.present)
    shares = np.sum(flight.present, axis=1)[:, None] * (each + price)
    return -0.5 * np.sum(unit**2, axis=1) - constant[:, None] - shares


def draw_flights(
    marginal: Marginal, xi: Component, numbers: tuple[Normals, ...], hyper: NoiseParameters | None = None
) -> tuple[Lifted, ...]:
    """Draws of every flight's unknowns and trajectory given theta, by simulation smoothing (Durbin and Koopman 2002).

    A draw of the linear model is moved onto the data by the smoother. The full equations then depart from the linear
    model by more than the posterior's width, so the move is repeated along the draw's own path (randomised
    optimisation, Bardsley et al. 2014, with fixed derivatives). Where that changes a draw by half as much as draws
    differ, or more, it stays as it was: canopies out of sight for long may be led out of what can be simulated.

    Args:
        marginal: The posterior.
        xi: Standard coordinates of the parameters (P, B).
        numbers: From `normals`, per flight; zeros give the conditional modes.
        hyper: Noise parameters of this draw; the marginal's where None.

    Returns:
        Start (D, B), process noise (T, L, B), disturbances (T, A, B) and path (T, X, B) per flight.
    """
    theta, shift = shifted(marginal, xi)
    noise_parameters, found = hyper or marginal.hyper, []
    for flight, along, z in zip(marginal.flights, marginal.along, numbers, strict=True):
        made = along.gains if hyper is None else filter_gains(flight, hyper, along.linear)
        aside, _, aside_path = jax.tree.map(partial(_followed, np.asarray(shift)[along.parameters]), along.aside)
        latent_path = latent_path_at(flight, along, shift)
        free, away = drawn(
            flight, noise_parameters, made, seen_along(along, *stepped(flight, theta, latent_path), shift), z
        )
        held = np.zeros(np.shape(theta))
        path = moved(flight, latent_path.path, away + aside_path, theta, held)
        for _ in range(_CORRECTIONS):
            latent_path = latent_path_of(flight, noise_parameters, jax.tree.map(np.add, free, aside))._replace(
                path=path
            )
            residual, defects = stepped(flight, theta, latent_path)
            seen = Seen(  # the linear model has no correction here
                residual + np.asarray(along.linear.steps.out_state) @ aside_path,
                np.asarray(defects) - disturbed(along.linear.steps, latent_path_of(flight, noise_parameters, free)),
            )
            again, away = drawn(flight, noise_parameters, made, seen, z)
            free, path = _where_small(free, path, again, moved(flight, path, away, theta, held))
        unknowns = jax.tree.map(np.add, free, aside)
        found.append(Lifted(unknowns, latent_path_of(flight, noise_parameters, unknowns).error, path))
    return tuple(found)


def _followed(shift: Array, slope: Component) -> Array:
    return np.tensordot(slope, shift, axes=1)


def _where_small(free: Unknowns, path: Component, again: Unknowns, there: Component) -> tuple[Unknowns, Component]:
    """Unknowns and path of each draw after a correction; before it where its root mean square is a half or more."""
    change = np.concatenate([np.reshape(b - a, (-1, path.shape[-1])) for a, b in zip(free, again, strict=True)])
    small = np.isfinite(there).all(axis=(0, 1)) & (np.mean(change**2, axis=0) < _MOST_CORRECTED**2)
    return jax.tree.map(lambda a, b: np.where(small, b, a), (free, path), (again, there))


def in_batches(function: Callable[[Array], Any], xi: Array, batch: int = BATCH, side_by_side: bool = False) -> Any:
    """Apply a function of (P, batch) to (P, B) in equal pieces, so that one compilation serves; last axes joined.

    Side by side: on all processors, for a function that may be called at the same time.
    """
    count = xi.shape[-1]
    padded = np.concatenate([xi, np.repeat(xi[..., -1:], -count % batch, axis=-1)], axis=-1)
    parts = [padded[..., i : i + batch] for i in range(0, padded.shape[-1], batch)]
    if side_by_side:
        with ThreadPoolExecutor(processors()) as pool:
            pieces = list(pool.map(function, parts))
    else:
        pieces = [function(part) for part in parts]
    return jax.tree.map(lambda *a: np.concatenate([np.asarray(x) for x in a], axis=-1)[..., :count], *pieces)
