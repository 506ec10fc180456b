"""Dispersion of the scores of a record's parts: do they agree about the parameters as far as the model says?

If a model is right, the covariance of the score is the Fisher information (White 1982, Econometrica 50, 1-25).
Aerodynamics of another form than the model's leave errors that return with every swing. To a latent process they are
new after each of its time constants, so a longer record makes intervals narrower though it repeats the same error; and
one part of the record draws the parameters elsewhere than another. Scores of parts then scatter more than their
information says, and the more so the longer the parts, if the error keeps its sign over many swings: what counts is the
variance of the scores over the whole record (Newey and West 1987, Econometrica 55, 703-708), which long parts show and
short parts tell more surely. So parts of three lengths are looked at.

What follows is a posterior with a tempered likelihood (Miller and Dunson 2019, J. Am. Stat. Assoc. 114, 1113-1125):
only a share of the record's information counts. It is the sandwich covariance where its middle is a multiple of the
information; a few parts of a record tell that multiple, but no matrix. They tell the multiple itself to a third or so.
A test that widens by it or not at all is wrong to both sides: small misfit is passed over, and what is just found is
taken for what is. So the share is averaged over its own posterior: as probable as not it is one, otherwise anything
below (uniform), and a length of parts tells its ratio with the law of chi-square.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, gammaln, softmax
from scipy.stats import chi2

from bayeschute.posterior.marginal import Marginal

Array = NDArray[np.float64]
PARTS = 12
"""Parts of every record, of equal length."""
_JOINED = (1, 2, 4)  # neighbours that are taken as one: twelfths, sixths and thirds of a record
_LEVEL = 0.99  # least probability that no ratio is above its bound where the model is right
_INFORMED = 0.05  # least share of the data in the precision along a direction that counts
_LEAST = 0.1  # of the scatter that is left to parts once all agree on the parameters, below which they tell nothing
_SMALL = 0.3  # ratios below it are taken for it: they say as little of a share below one


class Dispersion(NamedTuple):
    """How much more the scores of parts of the records scatter than the model allows.

    Attributes:
        ratio: Of their scatter and that by their information; 1 on average where the model is right. NaN where the
            records have too few parts that tell of the parameters. Of the length of parts whose ratio is largest
            beside its bound.
        bound: Of that ratio. In 99 of 100 records none is above its bound where the model is right (Bonferroni).
        factor: By which variances that the records determine are to be widened: the mean of the ratio over its
            posterior; 1 where no part tells.
        widening: Logarithm of the factor on the parameters' covariance that follows, standard coordinates (P, P).
    """

    ratio: float
    bound: float
    factor: float
    widening: Array

    @property
    def disagree(self) -> bool:
        """Whether parts of the records disagree by more than chance."""
        return self.ratio > self.bound


def parts_of(marginal: Marginal, parts: int = PARTS) -> tuple[Array, Array]:
    """Scores (B, P) and information (B, P, P) of the parts of all records, record by record, standard coordinates."""
    scores, informations = list[Array](), list[Array]()
    for along in marginal.along:
        unit = np.asarray(along.unit)
        slope = unit[..., 1:] @ np.asarray(marginal.scale)[along.parameters]
        for rows in np.array_split(np.arange(len(unit)), parts):
            scores.append(np.einsum("tcp,tc->p", slope[rows], unit[rows, :, 0]))
            informations.append(np.einsum("tcp,tcq->pq", slope[rows], slope[rows]))
    return np.array(scores), np.array(informations)


def dispersion(scores: Array, informations: Array) -> Dispersion:
    """The ratio of the scatter of scores to that by their information, and what follows for the covariance.

    The scores' sum is taken out: it is balanced by the slopes of prior and log determinant at the mode.

    Args:
        scores: Of every part (B, P), in coordinates in which the posterior's precision is the unit matrix. `PARTS` of
            each record, in the order of time.
        informations: Likewise (B, P, P).

    Raises:
        ValueError: If B is no multiple of `PARTS`.
    """
    if len(scores) % PARTS:
        raise ValueError(f"scores: {PARTS} parts of every record are wanted, got {len(scores)}")
    shares, axes = np.linalg.eigh(np.sum(informations, axis=0))
    told = shares > _INFORMED
    whitened = axes[:, told] / np.sqrt(shares[told])
    unit = scores @ whitened
    each = np.swapaxes(whitened[None], 1, 2) @ informations @ whitened
    unit = unit - each @ unit.sum(axis=0)
    found = [_ratio(_joined(unit, count), _joined(each, count)) for count in _JOINED] if told.any() else []
    found = [one for one in found if np.isfinite(one.value)]
    if not found:
        return Dispersion(np.nan, np.inf, 1.0, np.zeros_like(informations[0]))
    worst = max(found, key=lambda one: one.value / one.bound)
    factor = _expected(found)
    by_data = np.clip(shares, 0.0, 1.0)
    widening = -(axes * np.log(by_data / factor + 1.0 - by_data)) @ axes.T
    return Dispersion(worst.value, worst.bound, factor, np.asarray(widening))


class _Ratio(NamedTuple):
    """Of one length of parts: about chi-square over its degrees of freedom where the model is right."""

    value: float
    freedom: float

    @property
    def bound(self) -> float:
        """Above which one of the lengths is in one of a hundred right models."""
        return float(chi2.ppf(1.0 - (1.0 - _LEVEL) / len(_JOINED), self.freedom) / self.freedom)


def _expected(found: Sequence[_Ratio]) -> float:
    """Posterior mean of the true ratio, which is one or the reciprocal of a share that is uniform below one.

    Given a share `u`, the likelihood of a ratio is that of a scaled chi-square, ``u^a exp(-u x)`` with half its degrees
    of freedom and half its sum, beside that of ``u = 1``; its integrals over `u` are incomplete gamma functions. Which
    length of parts shows the error is not known: each is as probable as another.
    """
    half = 0.5 * np.array([one.freedom for one in found])
    x = half * np.maximum([one.value for one in found], _SMALL)
    below = gammainc(half + 1.0, x)
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # zero: many flights that agree all too well, for a share of one
        evidence = x + gammaln(half + 1.0) + np.log(below) - (half + 1.0) * np.log(x)
        mean = np.where(below > 0.0, x / half * gammainc(half, x) / below, 1.0)
    weight = softmax(np.array([0.0, *(evidence - np.log(len(found)))]))
    return float(weight @ np.array([1.0, *mean]))


def _joined(parts: Array, count: int) -> Array:
    """Sums over that many neighbours."""
    return np.asarray(parts.reshape(-1, count, *parts.shape[1:]).sum(axis=1))


def _ratio(unit: Array, each: Array) -> _Ratio:
    """Of centred scores (B, P), with information (B, P, P) whose sum is the unit matrix.

    Mean and variance of their sum of squares are those of a chi-square; NaN where the parts can't tell. The scores have
    the joint covariance E_b (where b = c) - E_b E_c; of that only the trace and the sum of squares are needed.
    """
    squares = each @ each
    expected = float(np.einsum("bii->", each) - np.einsum("bii->", squares))
    if expected < _LEAST * unit.shape[1]:
        return _Ratio(np.nan, np.nan)
    joint = np.sum(each**2) - 2.0 * np.sum(squares * each) + np.sum(np.sum(squares, axis=0) ** 2)
    return _Ratio(float(np.sum(unit**2)) / expected, expected**2 / float(joint))


def told_in_words(found: Dispersion, flights: Sequence[str], widened: bool = True) -> str:
    """What was found and done, for the notes of a run."""
    done = (
        f"Variances that the record determines are {found.factor:.2g} times larger than by the model alone."
        if widened
        else "Nothing is widened, as this noise model has no latent disturbances; intervals are too narrow."
    )
    return (
        f"Parts of {' and '.join(flights)} disagree about the parameters: their scores scatter {found.ratio:.2g} times "
        f"as much as the model says (by chance at most {found.bound:.2g}). The aerodynamics may have another form than "
        f"the model's, or disturbances a memory that the noise model lacks. {done}"
    )
