"""Dispersion of the scores of a record's parts: do they agree about the parameters as far as the model says?

If a model is right, the covariance of the score is the Fisher information (White 1982, Econometrica 50, 1-25).
Aerodynamics of another form than the model's leave errors that return with every swing. To a latent process they are
new after each of its time constants, so a longer record makes intervals narrower though it repeats the same error; and
one part of the record draws the parameters elsewhere than another. Scores of parts then scatter more than their
information says. By that ratio the information of the record is divided: a posterior with a tempered likelihood (Miller
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
PARTS = 6
"""Parts of every record, of equal length: longer than a swing, and enough for a ratio known to a fifth."""
_LEVEL = 0.99  # probability of a ratio below the bound where the model is right
_INFORMED = 0.05  # least share of the data in the precision along a direction that counts
_LEAST = 0.1  # of the scatter that is left to parts once all agree on the parameters, below which they tell nothing


class Dispersion(NamedTuple):
    """How much more the scores of parts of the records scatter than the model allows.

    Attributes:
        ratio: Of their scatter and that by their information; 1 on average where the model is right. NaN where the
            records have too few parts that tell of the parameters.
        bound: Below which it is in 99 of 100 records where the model is right.
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
    """Scores (B, P) and information (B, P, P) of the parts of all records, standard coordinates."""
    scores, informations = list[Array](), list[Array]()
    for along in marginal.along:
        unit = np.asarray(along.unit)
        slope = unit[..., 1:] @ np.asarray(marginal.scale)
        for rows in np.array_split(np.arange(len(unit)), min(parts, len(unit))):
            scores.append(np.einsum("tcp,tc->p", slope[rows], unit[rows, :, 0]))
            informations.append(np.einsum("tcp,tcq->pq", slope[rows], slope[rows]))
    return np.array(scores), np.array(informations)


def dispersion(scores: Array, informations: Array) -> Dispersion:
    """The ratio of the scatter of scores to that by their information, and what follows for the covariance.

    The scores' sum is taken out: it is balanced by the slopes of prior and log determinant at the mode.

    Args:
        scores: Of every part (B, P), in coordinates in which the posterior's precision is the unit matrix.
        informations: Likewise (B, P, P).
    """
    total = np.sum(informations, axis=0)
    shares, axes = np.linalg.eigh(total)
    told = shares > _INFORMED
    none = Dispersion(np.nan, np.inf, np.zeros_like(total))
    if not told.any():
        return none
    whitened = axes[:, told] / np.sqrt(shares[told])
    unit = scores @ whitened
    each = np.swapaxes(whitened[None], 1, 2) @ informations @ whitened
    unit = unit - each @ unit.sum(axis=0)
    count, size = unit.shape
    joint = scipy.linalg.block_diag(*each) - np.einsum("bij,cjk->bick", each, each).reshape(count * size, -1)
    expected = float(np.trace(joint))
    if expected < _LEAST * size:
        return none
    ratio = float(np.sum(unit**2)) / expected
    freedom = expected**2 / float(np.sum(joint**2))
    bound = float(chi2.ppf(_LEVEL, freedom) / freedom)
    if ratio <= bound:
        return Dispersion(ratio, bound, none.widening)
    by_data = np.clip(shares, 0.0, 1.0)
    return Dispersion(ratio, bound, np.asarray(-(axes * np.log(by_data / ratio + 1.0 - by_data)) @ axes.T))


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
