"""Noise models of a residual from the simplest to the richest, each exact for its stated process (METHODS 5).

Every rung is a set of parameters; `log_density` and `innovation_terms` take a residual, its times and any of them. All
are JAX functions, linear in the length of the record, differentiable in residual, times and parameters, and let data be
missing (NaN): a missing sample adds nothing, and the filter carries its uncertainty across. In a numpyro model:
``numpyro.factor("noise", log_density(residual, time, OU(sd, time_constant)))``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import jax.scipy.special

from bayeschute.air.vector import Component

_LOG_2_PI = 1.8378770664093453


class White(NamedTuple):
    """Independent normal errors.

    Attributes:
        sd: Standard deviation, of one series or per column (C,).
    """

    sd: Component


class AR1(NamedTuple):
    """First-order autoregression on a uniform grid, stationary.

    Attributes:
        sd: Stationary standard deviation.
        coefficient: Correlation of neighbours, within -1..1 [1].
    """

    sd: Component
    coefficient: Component


class AR1White(NamedTuple):
    """First-order autoregression and independent errors, added, on a uniform grid.

    Attributes:
        sd: Stationary standard deviation of the correlated part.
        coefficient: Its correlation of neighbours, within -1..1 [1].
        white: Standard deviation of the independent part; zero is allowed.
    """

    sd: Component
    coefficient: Component
    white: Component


class ARMA11(NamedTuple):
    """``r_t = coefficient r_{t-1} + e_t + moving e_{t-1}`` on a uniform grid, stationary.

    Attributes:
        shock: Standard deviation of e.
        coefficient: Autoregression, within -1..1 [1].
        moving: Moving average [1].
    """

    shock: Component
    coefficient: Component
    moving: Component


class OU(NamedTuple):
    """Ornstein-Uhlenbeck process at any increasing times, with independent errors where wanted.

    Attributes:
        sd: Stationary standard deviation.
        time_constant: e-folding time [s].
        white: Standard deviation of independent errors.
    """

    sd: Component
    time_constant: Component
    white: Component = 0.0


class StudentT(NamedTuple):
    """A Markov chain whose every datum, given the one before it in the record, is Student-t.

    With ``a = exp(-gap/time_constant)`` the datum is ``a`` times the last one plus a Student-t number of scale
    ``scale sqrt(1 - a^2)``; the first has the scale itself. Across missing samples the last datum that exists serves,
    so the chain is one of the data as recorded. Many degrees of freedom give `OU`.

    Attributes:
        scale: Scale of the first datum.
        time_constant: e-folding time [s].
        freedom: Degrees of freedom [1].
    """

    scale: Component
    time_constant: Component
    freedom: Component


class VectorAR1(NamedTuple):
    """First-order autoregression of several columns whose shocks are correlated, on a uniform grid, stationary.

    Attributes:
        root: Lower Cholesky factor of the covariance of the shocks (C, C).
        coefficient: Correlation of neighbours per column, within -1..1 (C,) [1].
    """

    root: Component
    coefficient: Component


Rung = White | AR1 | AR1White | ARMA11 | OU | StudentT | VectorAR1


def _normal(error: Component, variance: Component, here: jax.Array) -> jax.Array:
    """Log density of a normal error; zero where nothing was recorded."""
    safe = jnp.where(here, variance, 1.0)
    return jnp.where(here, -0.5 * (_LOG_2_PI + jnp.log(safe) + error**2 / safe), 0.0)


def _white(z: jax.Array, here: jax.Array, gap: jax.Array, rung: White) -> jax.Array:
    return _normal(z, jnp.broadcast_to(jnp.asarray(rung.sd) ** 2, z.shape), here)


def _markov(
    z: jax.Array, here: jax.Array, keep: jax.Array, share: jax.Array, variance: Component, white: Component
) -> jax.Array:
    """Log densities (T, C) of a scalar Markov process seen with independent errors.

    Args:
        z: Residuals (T, C), zero where missing.
        here: Which exist (T, C).
        keep: Correlation with the sample before (T, C); the first is not used.
        share: ``1 - keep^2``, without cancellation (T, C).
        variance: Stationary variance (C,).
        white: Variance of the independent errors (C,).
    """
    stationary = jnp.broadcast_to(jnp.asarray(variance, float), z.shape[1:])

    def step(state: tuple, row: tuple) -> tuple[tuple, jax.Array]:
        mean, spread = state
        z, here, keep, share = row
        mean, spread = keep * mean, keep**2 * spread + share * stationary
        total = spread + white
        gain = jnp.where(here, spread / total, 0.0)
        error = z - mean
        return (mean + gain * error, spread * jnp.where(here, white / total, 1.0)), _normal(error, total, here)

    first = (jnp.zeros_like(stationary), stationary)
    return jax.lax.scan(step, first, (z, here, keep.at[0].set(1.0), share.at[0].set(0.0)))[1]


def _constant(coefficient: Component, z: jax.Array) -> tuple[jax.Array, jax.Array]:
    phi = jnp.broadcast_to(jnp.asarray(coefficient, float), z.shape)
    return phi, (1.0 - phi) * (1.0 + phi)


def _ar1(z: jax.Array, here: jax.Array, gap: jax.Array, rung: AR1) -> jax.Array:
    return _markov(z, here, *_constant(rung.coefficient, z), jnp.asarray(rung.sd) ** 2, 0.0)


def _ar1_white(z: jax.Array, here: jax.Array, gap: jax.Array, rung: AR1White) -> jax.Array:
    return _markov(z, here, *_constant(rung.coefficient, z), jnp.asarray(rung.sd) ** 2, jnp.asarray(rung.white) ** 2)


def _ou(z: jax.Array, here: jax.Array, gap: jax.Array, rung: OU) -> jax.Array:
    steps = jnp.broadcast_to(gap[:, None] / rung.time_constant, z.shape)
    return _markov(
        z, here, jnp.exp(-steps), -jnp.expm1(-2.0 * steps), jnp.asarray(rung.sd) ** 2, jnp.asarray(rung.white) ** 2
    )


def _arma(z: jax.Array, here: jax.Array, gap: jax.Array, rung: ARMA11) -> jax.Array:
    """A filter whose state is (r_t, moving e_t) (Harvey 1989, section 3.3)."""
    phi, moving, q = (
        jnp.broadcast_to(jnp.asarray(a, float), z.shape[1:])
        for a in (rung.coefficient, rung.moving, jnp.asarray(rung.shock) ** 2)
    )

    def step(state: tuple, row: tuple) -> tuple[tuple, jax.Array]:
        r, m, rr, rm, mm = state
        z, here = row
        error, term = z - r, _normal(z - r, rr, here)
        m, mm = m + jnp.where(here, rm / rr * error, 0.0), mm - jnp.where(here, rm**2 / rr, 0.0)
        r, rr, rm = jnp.where(here, z, r), jnp.where(here, 0.0, rr), jnp.where(here, 0.0, rm)
        spread = phi**2 * rr + 2.0 * phi * rm + mm + q
        return (phi * r + m, jnp.zeros_like(m), spread, moving * q, moving**2 * q), term

    # r_t = (phi + moving) sum phi^k e_{t-1-k} + e_t, which keeps the variance free of cancellation.
    spread = q * (1.0 + (phi + moving) ** 2 / ((1.0 - phi) * (1.0 + phi)))
    first = (jnp.zeros_like(phi), jnp.zeros_like(phi), spread, moving * q, moving**2 * q)
    return jax.lax.scan(step, first, (z, here))[1]


def _student(z: jax.Array, here: jax.Array, gap: jax.Array, rung: StudentT) -> jax.Array:
    tau, scale, nu = (
        jnp.broadcast_to(jnp.asarray(a, float), z.shape[1:]) for a in (rung.time_constant, rung.scale, rung.freedom)
    )
    log_norm = jax.scipy.special.gammaln(0.5 * (nu + 1.0)) - jax.scipy.special.gammaln(0.5 * nu)
    log_norm = log_norm - 0.5 * jnp.log(nu * jnp.pi)

    def step(state: tuple, row: tuple) -> tuple[tuple, jax.Array]:
        last, age, seen = state
        z, here, gap = row
        age = age + gap
        steps = jnp.where(seen, age / tau, 1.0)
        keep = jnp.where(seen, jnp.exp(-steps), 0.0)
        variance = scale**2 * jnp.where(seen, -jnp.expm1(-2.0 * steps), 1.0)
        square = (z - keep * last) ** 2 / jnp.where(here, variance, 1.0)
        term = log_norm - 0.5 * jnp.log(jnp.where(here, variance, 1.0)) - 0.5 * (nu + 1.0) * jnp.log1p(square / nu)
        after = (jnp.where(here, z, last), jnp.where(here, 0.0, age), seen | here)
        return after, jnp.where(here, term, 0.0)

    first = (jnp.zeros_like(tau), jnp.zeros_like(tau), jnp.zeros(z.shape[1:], bool))
    return jax.lax.scan(step, first, (z, here, gap))[1]


def _vector(z: jax.Array, here: jax.Array, gap: jax.Array, rung: VectorAR1) -> jax.Array:
    count = z.shape[1]
    phi, root = jnp.broadcast_to(jnp.asarray(rung.coefficient, float), (count,)), jnp.asarray(rung.root, float)
    shock = root @ root.T
    # 1 - ab = (1 - a) + a (1 - b): no cancellation where both are close to one
    stationary = shock / ((1.0 - phi)[:, None] + phi[:, None] * (1.0 - phi)[None, :])

    def step(state: tuple, row: tuple) -> tuple[tuple, jax.Array]:
        mean, spread = state
        z, here = row
        error = jnp.where(here, z - mean, 0.0)
        seen = jnp.where(here[:, None], spread, 0.0)
        total = jnp.where(here[None, :], seen, 0.0) + jnp.diag(jnp.where(here, 0.0, 1.0))
        low = jnp.linalg.cholesky(total)
        unit = jax.scipy.linalg.solve_triangular(low, error, lower=True)
        half = jax.scipy.linalg.solve_triangular(low, seen, lower=True)
        mean, left = mean + half.T @ unit, spread - half.T @ half
        both = here[:, None] | here[None, :]  # nothing is left of what was seen
        spread = jnp.where(both, 0.0, 0.5 * (left + left.T))
        term = -0.5 * unit @ unit - jnp.sum(jnp.log(jnp.diagonal(low))) - 0.5 * _LOG_2_PI * jnp.sum(here)
        return (phi * mean, phi[:, None] * spread * phi[None, :] + shock), term

    return jax.lax.scan(step, (jnp.zeros(count), stationary), (z, here))[1]


_TERMS: dict[type, Callable[..., jax.Array]] = {
    White: _white,
    AR1: _ar1,
    AR1White: _ar1_white,
    ARMA11: _arma,
    OU: _ou,
    StudentT: _student,
    VectorAR1: _vector,
}


@jax.jit
def innovation_terms(residual: Component, time: Component, parameters: Any) -> jax.Array:
    """Log density of every sample given all earlier ones.

    Args:
        residual: One series (T,) or several columns (T, C); NaN where nothing was recorded.
        time: Times, increasing (T,) [s]; only `OU` and `StudentT` look at them, the others count samples.
        parameters: A rung; each number is a scalar or one per column, which are independent but for `VectorAR1`.

    Returns:
        (T,), columns added up; zero where nothing was recorded.
    """
    z, t = jnp.asarray(residual, float), jnp.asarray(time, float)
    z = z[:, None] if z.ndim == 1 else z
    here = jnp.isfinite(z)
    gap = jnp.concatenate([jnp.zeros(1), jnp.diff(t)])
    made = _TERMS[type(parameters)](jnp.where(here, z, 0.0), here, gap, parameters)
    return made if made.ndim == 1 else jnp.sum(made, axis=1)


def log_density(residual: Component, time: Component, parameters: Rung) -> jax.Array:
    """Log density of a residual, the sum of `innovation_terms`."""
    return jnp.sum(innovation_terms(residual, time, parameters))
