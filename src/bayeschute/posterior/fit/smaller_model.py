"""A model with some of a library's terms, fitted beside the library: each begins where the other has led."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayeschute.likelihood.joint import FlightData, Lifted
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.fit.continuation import Progress
from bayeschute.posterior.fit.joint_fit import FEW_DEFECTS, JointFit
from bayeschute.posterior.fit.marginal_mode import marginal_mode
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.term_search import most_probable

Array = NDArray[np.float64]
_STEPS, _NEAR = 6, 2.0  # most steps to the smaller model's mode; length of the last [standard deviations]
_FAR_BELOW = 500.0  # the library's log density: where a smaller model begins there, its mode is in reach of nothing


class Smaller(NamedTuple):
    """A model with some of the parameters of a library, the others known to be zero.

    Attributes:
        flights: Records, for its parameters.
        priors: Of its parameters (Q of P), in the order of the library.
        kept: Which of the library's it has (P,).
    """

    flights: Sequence[FlightData]
    priors: Sequence[Prior]
    kept: NDArray[np.bool_]

    def in_library(self, theta: Array) -> Array:
        """Parameters of the library (P,) for which it is this model with its (Q,)."""
        whole = np.zeros(self.kept.size)
        whole[self.kept] = theta
        return whole


def carried_over(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    other: JointFit,
    theta: Array,
    at: Sequence[Lifted],
) -> JointFit | None:
    """A fit of a model at the place where one with more or fewer terms has led, with the noise parameters of that one.

    The marginal mode of a model can lie a hundred standard deviations from its joint optimum; where one of another
    model is known, the way through the joint optimum and back is spared.

    Args:
        flights: Records, for the parameters of the model.
        priors: Priors of its parameters.
        prior: Priors of the noise parameters.
        other: The fit of the other model.
        theta: Parameters of the model there, working coordinates (P,).
        at: Start, process noise and path of every flight there.

    Returns:
        A place to seek the marginal mode from, no joint optimum; None where flights don't follow the record.
    """
    rest = conditional_mode.conditional_optimum(flights, other.hyper, priors, theta, at)
    if rest is None or not rest.defect < FEW_DEFECTS:
        return None
    covariance = scipy.linalg.inv(rest.matrix)
    found = replace(other.optimum, theta=theta, flights=rest.flights, covariance=covariance, cost=rest.cost)
    evidence = noise_evidence.function_of(flights, found.linear(flights), priors, prior)
    return JointFit(found, other.hyper, evidence(noise_evidence.to_vector(other.hyper))[0])


def beside_smaller(
    flights: Sequence[FlightData],
    priors: Sequence[Prior],
    prior: NoisePrior,
    library: JointFit,
    small: Smaller,
    progress: Progress | None = None,
) -> JointFit:
    """Where to seek a library's marginal mode from: its joint optimum, or near the mode of a small model of its terms.

    A library has many places where the density is greatest round about: powers of the angle that balance each other,
    damping by angle against damping. A model without such terms has no such places. From the library's path it takes
    a few steps to near its mode, where the library may be more probable than at its own joint optimum.

    Args:
        flights: Records, for the parameters of the library.
        priors: Their priors.
        prior: Priors of the noise parameters.
        library: Its joint fit.
        small: The small model.
        progress: Progress callback: share done and words.

    Returns:
        The joint fit, or the library at the small model's place where its marginal density is greater.
    """
    say = progress or (lambda share, words: None)
    best = library.optimum
    if small.kept.all():
        return library
    say(0.0, "fewest terms: from the path that the full library found")
    theta = most_probable(best.theta, best.covariance, small.kept)
    start = carried_over(small.flights, small.priors, prior, library, theta, best.flights)
    if start is None:
        say(1.0, "fewest terms: no flight follows the record from where the library led")
        return library
    own = _density(flights, priors, library)
    if (less := _density(small.flights, small.priors, start) - own) < -_FAR_BELOW:
        say(1.0, f"fewest terms: log density {less:+.1f} over the joint optimum's where they start, given up")
        return library
    try:
        mode = marginal_mode(
            small.flights, small.priors, start, lambda share, words: say(0.9 * share, f"fewest terms: {words}"),
            _STEPS, _NEAR, own,
        )  # fmt: skip
    except FloatingPointError as error:
        say(1.0, f"fewest terms: {error}")
        return library
    whole = small.in_library(mode.theta)
    there = carried_over(flights, priors, prior, library, whole, mode.flights)
    if there is None:
        say(1.0, "fewest terms: no flight of the library follows the record where they led")
        return library
    gain = _density(flights, priors, there) - own
    say(1.0, f"fewest terms: log density {gain:+.1f} over the joint optimum's")
    return there if gain > 0.0 else library


def _density(flights: Sequence[FlightData], priors: Sequence[Prior], place: JointFit) -> float:
    """Marginal log density of the parameters at a place by Laplace's approximation, up to constants."""
    best = place.optimum
    rest = conditional_mode.conditional_optimum(flights, place.hyper, priors, best.theta, best.flights)
    return -rest.marginal if rest is not None else -np.inf
