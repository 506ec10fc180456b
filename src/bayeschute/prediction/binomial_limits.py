"""Monte Carlo limits: Clopper-Pearson and Jeffreys limits of a probability, and Wilks' tolerance limits.

Clopper and Pearson, Biometrika 26 (1934) 404; Wilks, Ann. Math. Statist. 12 (1941) 91; Jeffreys' prior Beta(1/2, 1/2)
as in Brown, Cai and DasGupta, Statist. Sci. 16 (2001) 101.
"""

from __future__ import annotations

from typing import NamedTuple

from scipy.special import bdtr, betaincinv

from bayeschute.core.errors import Fault, InputError


class Limits(NamedTuple):
    """Two-sided limits of a probability [1]."""

    low: float
    high: float


def _share(where: str, value: float) -> None:
    """Refuse a share or confidence that is not strictly between 0 and 1."""
    if not 0.0 < value < 1.0:
        raise InputError(Fault(where, repr(value), "a number strictly between 0 and 1", "Write 90 % as 0.9."))


def _count(where: str, count: float, total: float) -> None:
    """Refuse counts that are negative or exceed their total."""
    if not (total > 0 and 0 <= count <= total):
        raise InputError(Fault(where, f"{count} of {total}", "0 <= count <= total and total > 0"))


def clopper_pearson(count: float, total: float, confidence: float = 0.9) -> Limits:
    """Limits of a share that hold with at least the stated confidence, whatever the true share is.

    Args:
        count: How many of the independent trials had the event; need not be whole (effective numbers).
        total: Number of independent trials.
        confidence: Two-sided confidence [1].

    Returns:
        The limits; 0 below no event and 1 above nothing but events.

    Raises:
        InputError: If the counts or the confidence make no sense.
    """
    _count("clopper_pearson count", count, total)
    _share("clopper_pearson confidence", confidence)
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count <= 0 else float(betaincinv(count, total - count + 1.0, tail))
    high = 1.0 if count >= total else float(betaincinv(count + 1.0, total - count, 1.0 - tail))
    return Limits(low, high)


def jeffreys(count: float, total: float, confidence: float = 0.9) -> Limits:
    """Equal-tailed credible limits of a share under Jeffreys' prior Beta(1/2, 1/2).

    Args:
        count: How many of the independent trials had the event; need not be whole.
        total: Number of independent trials.
        confidence: Probability between the limits [1].

    Returns:
        The limits; 0 and 1 at the edges, where the equal-tailed limit would exclude the observed share.

    Raises:
        InputError: If the counts or the confidence make no sense.
    """
    _count("jeffreys count", count, total)
    _share("jeffreys confidence", confidence)
    tail = (1.0 - confidence) / 2.0
    a, b = count + 0.5, total - count + 0.5
    low = 0.0 if count <= 0 else float(betaincinv(a, b, tail))
    high = 1.0 if count >= total else float(betaincinv(a, b, 1.0 - tail))
    return Limits(low, high)


def wilks_confidence(total: int, share: float, failures: int = 0) -> float:
    """Confidence that the (failures+1)-th greatest of independent draws exceeds the `share` quantile.

    Args:
        total: Number of independent draws.
        share: Share of the population to be covered [1].
        failures: Draws allowed above the limit.

    Returns:
        1 - P(Binomial(total, 1 - share) <= failures) [1].
    """
    if failures >= total:
        return 0.0
    return 1.0 - float(bdtr(failures, total, 1.0 - share))


def wilks_sample_size(share: float, confidence: float, failures: int = 0) -> int:
    """Least number of independent draws that proves a share with a confidence, some failures allowed.

    Args:
        share: Share of the population to be covered, e.g. 0.99865 [1].
        confidence: One-sided confidence, e.g. 0.9 [1].
        failures: Draws allowed beyond the requirement.

    Returns:
        The least N with P(Binomial(N, 1 - share) <= failures) <= 1 - confidence.

    Raises:
        InputError: If a share is outside (0, 1) or the failures are negative.
    """
    _share("wilks_sample_size share", share)
    _share("wilks_sample_size confidence", confidence)
    if failures < 0:
        raise InputError(Fault("wilks_sample_size failures", repr(failures), "a whole number >= 0"))
    low, high = failures, failures + 1  # low never proves it
    while wilks_confidence(high, share, failures) < confidence:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        if wilks_confidence(middle, share, failures) < confidence:
            low = middle
        else:
            high = middle
    return high


def wilks_failures(total: int, share: float, confidence: float) -> int:
    """Most failures that `total` independent draws may have and still prove the share; -1 if none will do."""
    allowed = -1
    while wilks_confidence(total, share, allowed + 1) >= confidence:
        allowed += 1
    return allowed
