"""Priors of named parameters: jointly Gaussian in working coordinates (the value, or its logarithm).

Equation error determines sums of terms best: the mean force is known to a few per cent where none of its terms is. So
priors include the correlations of their estimates, by name; correlations with absent parameters are ignored, which
gives the marginal distribution of those present.

A record tells forces by the motion of the masses that they move. What is not known of a canopy's apparent mass makes
all its coefficients of transverse force larger alike: a ridge, and a curved one where their working coordinates are the
values. So these may be the values at the vehicle's own apparent mass (`Prior.air_share`), along which it is straight,
and which are what equation error estimates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.special import chdtri

from bayeschute.aero.coefficient import APPARENT_MASS

_FREEDOM = 4.0  # nu, degrees of freedom of a heavy-tailed prior
_CONFLICT = 0.01  # p-value of a distance from the centre beyond which it counts (Evans and Moshonov 2006)


@dataclass(frozen=True)
class Prior:
    """The prior of one parameter.

    Attributes:
        name: Parameter.
        centre: Mean of the working coordinate.
        scale: Standard deviation of the working coordinate.
        logarithmic: Whether the working coordinate is the logarithm of the value.
        unit: Unit of the value.
        source: Where it comes from, in words.
        correlation: With other parameters, by name.
        air_share: Share s of the vehicle's apparent mass in what a canopy moves [1]: where a factor f on it is a
            parameter too, the value is the working coordinate times 1 + s (f - 1). Zero: it does not depend on it.
        widened: By how much `scale` is larger than its source says, since the flights contradict it [1]
            (`conflict_variance_factor`).
        saturation: Of a coefficient: angle of attack at which its powers in the term level off [rad]; None: nowhere.
    """

    name: str
    centre: float
    scale: float
    logarithmic: bool
    unit: str
    source: str
    correlation: Mapping[str, float] = field(default_factory=dict)
    air_share: float = 0.0
    widened: float = 1.0
    saturation: float | None = None

    def value(self, working: NDArray[np.float64]) -> NDArray[np.float64]:
        """The value from the working coordinate, at the vehicle's apparent mass."""
        return np.exp(working) if self.logarithmic else np.asarray(working)

    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation of the value."""
        if not self.logarithmic:
            return self.centre, self.scale
        mean = float(np.exp(self.centre + 0.5 * self.scale**2))
        return mean, mean * float(np.sqrt(np.expm1(self.scale**2)))


def from_equation_error(
    name: str, estimate: float, se: float, inflation: float, floor: float, unit: str = "1", flight: str = ""
) -> Prior:
    """A prior centred on an equation-error estimate (METHODS 4).

    Args:
        name: Parameter.
        estimate: Its equation-error estimate.
        se: Its colored standard error.
        inflation: Factor on the standard error, against using the data twice.
        floor: Least scale.
        unit: Unit of the value.
        flight: Where the estimate comes from, for the report.

    Returns:
        The prior.
    """
    scale = max(inflation * se, floor)
    return Prior(
        name, estimate, scale, False, unit, f"equation error on {flight}, {inflation:g} x colored standard error"
    )


def read_priors(entries: Iterable[Mapping[str, Any]]) -> list[Prior]:
    """Priors as a file has them; files of 28 and 29 November 2026 call `Prior.saturation` ``held``."""
    return [Prior(**{"saturation" if key == "held" else key: value for key, value in one.items()}) for one in entries]


def saturation_of(priors: Sequence[Prior]) -> float | None:
    """Angle of attack at which its powers level off in the terms of these coefficients [rad]; None: nowhere.

    Args:
        priors: Of all parameters of a fit; those of coefficients that were found on several records may differ.

    Returns:
        The least of their angles, beyond which one of the coefficients at least was not seen.
    """
    return min((p.saturation for p in priors if p.saturation is not None), default=None)


def working(priors: Sequence[Prior]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and scales of several priors, (P,) each; their correlations are in `factor`."""
    return np.array([p.centre for p in priors]), np.array([p.scale for p in priors])


def factor(priors: Sequence[Prior]) -> NDArray[np.float64]:
    """Lower Cholesky factor of the covariance of several priors (P, P); diagonal where none is correlated."""
    scale = np.array([p.scale for p in priors])
    if not any(p.correlation for p in priors):
        return np.diag(scale)
    return np.asarray(np.linalg.cholesky(covariance(priors)))


def covariance(priors: Sequence[Prior]) -> NDArray[np.float64]:
    """Covariance of several priors in working coordinates (P, P)."""
    place = {p.name: i for i, p in enumerate(priors)}
    found = np.diag([p.scale**2 for p in priors])
    for i, p in enumerate(priors):
        for name, r in p.correlation.items():
            if name in place and p.name in priors[place[name]].correlation:
                found[i, place[name]] = r * p.scale * priors[place[name]].scale
    return found


def precision(priors: Sequence[Prior]) -> NDArray[np.float64]:
    """Inverse of the covariance of several priors (P, P)."""
    root = scipy.linalg.solve_triangular(factor(priors), np.eye(len(priors)), lower=True, check_finite=False)
    return np.asarray(root.T @ root)


def standard(priors: Sequence[Prior], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coordinates in which the priors are standard normal (..., P), of working coordinates (..., P).

    The sum of their squares is that of minus twice the log density; an entry is the parameter given those before it.
    """
    away = theta - working(priors)[0]
    flat = scipy.linalg.solve_triangular(
        factor(priors), away.reshape(-1, len(priors)).T, lower=True, check_finite=False
    )
    return np.asarray(flat.T.reshape(away.shape))


def correlated(
    priors: Sequence[Prior], centre: NDArray[np.float64], joint_covariance: NDArray[np.float64]
) -> list[Prior]:
    """Priors with other centres (P,) and the covariance (P, P) that goes with them."""
    scale = np.sqrt(np.diag(joint_covariance))
    made = []
    for i, p in enumerate(priors):
        row = {
            q.name: float(joint_covariance[i, j] / (scale[i] * scale[j]))
            for j, q in enumerate(priors)
            if j != i and joint_covariance[i, j]
        }
        made.append(replace(p, centre=float(centre[i]), scale=float(scale[i]), correlation=row))
    return made


def given_zero(priors: Sequence[Prior], zero: Sequence[str]) -> list[Prior]:
    """Priors of the other parameters once some are known to be zero: terms that a model goes without.

    Args:
        priors: Priors of all.
        zero: Names of those that are zero; their working coordinates are the values.
    """
    out = np.array([p.name in set(zero) for p in priors])
    joint_covariance, centre = covariance(priors), working(priors)[0]
    gain = (
        joint_covariance[np.ix_(~out, out)] @ np.linalg.inv(joint_covariance[np.ix_(out, out)])
        if out.any()
        else np.zeros((int(np.sum(~out)), 0))
    )
    left = [p for p, gone in zip(priors, out, strict=True) if not gone]
    after = joint_covariance[np.ix_(~out, ~out)] - gain @ joint_covariance[np.ix_(out, ~out)]
    return correlated(left, centre[~out] - gain @ centre[out], 0.5 * (after + after.T))


def growth(priors: Sequence[Prior], air: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """What values are over those at the vehicle's apparent mass (..., P), at factors on that (...); None: one."""
    share = np.array([p.air_share for p in priors])
    return np.ones(len(priors)) if air is None else 1.0 + share * (np.asarray(air)[..., None] - 1.0)


def values(priors: Sequence[Prior], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of working coordinates whose last axis is the parameter."""
    made = np.stack([p.value(theta[..., i]) for i, p in enumerate(priors)], axis=-1)
    return made * growth(priors, _air(priors, made))


def conflict_variance_factor(priors: Sequence[Prior], theta: NDArray[np.float64], names: Sequence[str]) -> float:
    """By how much a heavy-tailed prior of some parameters is wider than the Gaussian, at a place in conflict with it.

    A multivariate t distribution has, near a place, the shape of a Gaussian whose covariance is
    ``(nu + d^2) / (nu + r)`` times its own, d the distance from its centre in standard deviations and r the number of
    parameters (Lange, Little and Taylor 1989): the farther the data lead, the less the prior holds them.

    Args:
        priors: Of all parameters.
        theta: Where the data lead, working coordinates (P,).
        names: Of the parameters that share the t distribution.

    Returns:
        The factor on their covariance; 1 where a Gaussian leads that far with a probability of `_CONFLICT` or more.
    """
    here = [i for i, p in enumerate(priors) if p.name in set(names)]
    if not here:
        return 1.0
    some = [priors[i] for i in here]
    distance = float(np.sum(standard(some, np.asarray(theta)[here]) ** 2))
    if distance < chdtri(len(here), _CONFLICT):
        return 1.0
    return (_FREEDOM + distance) / (_FREEDOM + len(here))


def values_and_sds(
    priors: Sequence[Prior], theta: NDArray[np.float64], joint_covariance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values at working coordinates (P,) and, by the delta method, their standard deviations (P,).

    Args:
        priors: Of the parameters.
        theta: Working coordinates.
        joint_covariance: Of these (P, P).
    """
    made = values(priors, theta)
    slope = np.diag(np.where([p.logarithmic for p in priors], made, growth(priors, _air(priors, made))))
    for i, p in enumerate(priors):
        if p.name == APPARENT_MASS:
            slope[:, i] += [q.air_share * float(q.value(t)) * made[i] for q, t in zip(priors, theta, strict=True)]
    return made, np.sqrt(np.einsum("ij,jk,ik->i", slope, joint_covariance, slope))


def of_values(priors: Sequence[Prior], given: NDArray[np.float64]) -> NDArray[np.float64]:
    """Working coordinates of values whose last axis is the parameter: the inverse of `values`."""
    held = given / growth(priors, _air(priors, given))
    return np.stack([np.log(held[..., i]) if p.logarithmic else held[..., i] for i, p in enumerate(priors)], axis=-1)


def own_coordinates(priors: Sequence[Prior], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Working coordinates of the same values where none depends on the apparent mass (..., P): values or logarithms."""
    return of_values([replace(p, air_share=0.0) for p in priors], values(priors, theta))


def _air(priors: Sequence[Prior], made: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Among values (..., P) the factor on the apparent mass (...), if it is a parameter."""
    place = [i for i, p in enumerate(priors) if p.name == APPARENT_MASS]
    return made[..., place[0]] if place else None
