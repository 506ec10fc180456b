"""Dispersion of the scores of a record's parts: do they agree about the parameters as far as the model says?

If a model is right, the covariance of the score is the Fisher information (White 1982, Econometrica 50, 1-25).
Aerodynamics of another form than the model's leave errors that return with every swing. To a latent process they are
new after each of its time constants, so a longer record makes intervals narrower though it repeats the same error; and
one part of the record draws the parameters elsewhere than another. Scores of parts then scatter more than their
information says, and the more so the longer the parts, if the error keeps its sign over many swings: what counts is the
variance of the scores over the whole record (Newey and West 1987, Econometrica 55, 703-708), which long parts show and
short parts tell more surely. So parts of three lengths are looked at, and the one that contradicts the model most is
believed. By its ratio the information of the record is divided: a posterior with a tempered likelihood (Miller
and Dunson 2019, J. Am. Stat. Assoc. 114, 1113-1125), which is the sandwich covariance where its middle is a multiple of
the information. A few parts of a record tell that multiple, but no matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.stats import chi2

from bayeschute.posterior.marginal import Marginal

Array = NDArray[np.float64]
PARTS = 12
"""Parts of every record, of equal length."""
_JOINED = (1, 2, 4)  # neighbours that are taken as one: twelfths, sixths and thirds of a record
_LEVEL = 0.99  # least probability that no ratio is above its bound where the model is right
_INFORMED = 0.05  # least share of the data in the precision along a direction that counts
_LEAST = 0.1  # of the scatter that is left to parts once all agree on the parameters, below which they tell nothing


class Dispersion(NamedTuple):
    """How much more the scores of parts of the records scatter than the model allows.

    Attributes:
        ratio: Of their scatter and that by their information; 1 on average where the model is right. NaN where the
            records have too few parts that tell of the parameters. Of the length of parts whose ratio is largest
            beside its bound.
        bound: Of that ratio. In 99 of 100 records none is above its bound where the model is right (Bonferroni).
        widening: Logarithm of the factor on the parameters' covariance, standard coordinates (P, P); zero where the
            ratio is below the bound.
    """

    ratio: float
    bound: float
    widening: Array

    @property
    def widens(self) -> bool:
        """Whether the posterior is widened."""
        return self.ratio > self.bound


def parts_of(marginal: Marginal, parts: int = PARTS) -> tuple[Array, Array]:
    """Scores (B, P) and information (B, P, P) of the parts of all records, record by record, standard coordinates."""
    scores, informations = list[Array](), list[Array]()
    for along in marginal.along:
        unit = np.asarray(along.unit)
        slope = unit[..., 1:] @ np.asarray(marginal.scale)
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
    found = [one for one in found if np.isfinite(one[0])]
    nothing = np.zeros_like(informations[0])
    if not found:
        return Dispersion(np.nan, np.inf, nothing)
    ratio, bound = max(found, key=lambda one: one[0] / one[1])
    if ratio <= bound:
        return Dispersion(ratio, bound, nothing)
    by_data = np.clip(shares, 0.0, 1.0)
    return Dispersion(ratio, bound, np.asarray(-(axes * np.log(by_data / ratio + 1.0 - by_data)) @ axes.T))


def _joined(parts: Array, count: int) -> Array:
    """Sums over that many neighbours."""
    return np.asarray(parts.reshape(-1, count, *parts.shape[1:]).sum(axis=1))


def _ratio(unit: Array, each: Array) -> tuple[float, float]:
    """Ratio and its bound of centred scores (B, P), with information (B, P, P) whose sum is the unit matrix.

    The ratio is about chi-square over its degrees of freedom, by mean and variance; NaN where the parts can't tell.
    """
    count, size = unit.shape
    joint = scipy.linalg.block_diag(*each) - np.einsum("bij,cjk->bick", each, each).reshape(count * size, -1)
    expected = float(np.trace(joint))
    if expected < _LEAST * size:
        return np.nan, np.inf
    freedom = expected**2 / float(np.sum(joint**2))
    level = 1.0 - (1.0 - _LEVEL) / len(_JOINED)
    return float(np.sum(unit**2)) / expected, float(chi2.ppf(level, freedom) / freedom)


def told_in_words(found: Dispersion, flights: Sequence[str], widened: bool = True) -> str:
    """What was found and done, for the notes of a run."""
    done = (
        "The posterior is widened accordingly: variances that the record determines are that many times larger."
        if widened
        else "Nothing is widened, as this noise model has no latent disturbances; intervals are too narrow."
    )
    return (
        f"Parts of {' and '.join(flights)} disagree about the parameters: their scores scatter {found.ratio:.2g} times "
        f"as much as the model says (by chance at most {found.bound:.2g}). The aerodynamics may have another form than "
        f"the model's, or disturbances a memory that the noise model lacks. {done}"
    )
