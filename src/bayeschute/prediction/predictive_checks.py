"""Posterior predictive checks of a fitted record: is it one that the model makes?

If the model is right, the standardised one-step prediction errors (innovations) of a record are independent standard
normal numbers, and so are draws of the standardised process noise given the record (a posterior draw under data from
the model is a draw from the prior). Both are tested by statistics of the field: their mean, size, autocorrelation,
power near a frequency and, for innovations, uniformity of their probability integral transform, which is a
leave-future-out PIT. Estimates of noise parameters and coefficients are compared with their priors. Parameters are at
their estimates, which makes these tests conservative where a parameter can follow the misfit; what it can follow is
tested for by name (`posterior.assess.alternatives`). p-values of many statistics are corrected by Bonferroni's method.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, kstest, norm

Array = NDArray[np.float64]
BOUND = 0.01
"""Probability of a false alarm of a sound flight, over all statistics together."""
LAGS = 10
SHOWN = 4
"""Statistics named in a sentence."""
ESTIMATED = "estimated error"
"""Statistic of an error that a fit is tested for."""
FROM_PRIOR = "distance from the prior"
"""Statistic of an estimate that a prior was stated for."""
OCTAVE = np.sqrt(2.0)
"""Half an octave to both sides of a frequency is its band."""


class Check(NamedTuple):
    """A statistic of a flight.

    Attributes:
        flight: Name of the flight.
        what: Output, disturbance or parameter.
        statistic: Its name.
        value: Its value.
        expected: Its expectation under the model.
        p: p-value.
        unit: Of the value.
        matters: Whether a small p-value counts; not so of an error that would move no parameter.
    """

    flight: str
    what: str
    statistic: str
    value: float
    expected: float
    p: float
    unit: str = ""
    matters: bool = True

    @property
    def words(self) -> str:
        """The statistic with its value, expectation and p-value."""
        value = f"{self.value:.3g} {self.unit}".rstrip()
        return f"{self.statistic} of {self.what} {value} (expected {self.expected:.3g}, p = {self.p:.1g})"


def _two_sided(z: float) -> float:
    return float(2.0 * norm.sf(abs(z)))


def _of_chi2(value: float, dof: int) -> float:
    """Two-sided p-value of a chi-square statistic."""
    return float(min(1.0, 2.0 * min(chi2.cdf(value, dof), chi2.sf(value, dof))))


def mean_test(z: Array) -> tuple[float, float, float]:
    """Mean of standard normal numbers (n,): value, expectation, p-value."""
    return float(z.mean()), 0.0, _two_sided(float(z.mean() * np.sqrt(z.size)))


def size_test(z: Array) -> tuple[float, float, float]:
    """Mean square, by its chi-square distribution."""
    return float(np.mean(z**2)), 1.0, _of_chi2(float(np.sum(z**2)), z.size)


def autocorrelation_test(z: Array, lags: int = LAGS) -> tuple[float, float, float]:
    """Autocorrelation (Ljung and Box 1978) of the first lags; the value is that at lag one."""
    centred = z - z.mean()
    total = float(np.sum(centred**2))
    most = min(lags, z.size // 4)
    if total == 0.0 or most < 1:
        return 0.0, 0.0, 1.0
    r = np.array([float(np.sum(centred[k:] * centred[:-k])) / total for k in range(1, most + 1)])
    statistic = z.size * (z.size + 2.0) * float(np.sum(r**2 / (z.size - np.arange(1, most + 1))))
    return float(r[0]), 0.0, float(chi2.sf(statistic, most))


def power_test(z: Array, dt: float, frequency: float) -> tuple[float, float, float] | None:
    """Power within half an octave of a frequency [Hz] over that of white noise; None where no line lies in the band.

    Periodogram ordinates of white Gaussian noise are independent, each chi-square of two degrees of freedom.
    """
    lines = np.fft.rfftfreq(z.size, dt)
    band = (lines >= frequency / OCTAVE) & (lines <= frequency * OCTAVE) & (lines > 0.0) & (lines < 0.5 / dt)
    if not band.any():
        return None
    ordinates = np.abs(np.fft.rfft(z)[band]) ** 2 / z.size
    return float(ordinates.mean()), 1.0, _of_chi2(2.0 * float(ordinates.sum()), 2 * int(band.sum()))


def pit_test(z: Array) -> tuple[float, float, float]:
    """Uniformity of the probability integral transform (Kolmogorov and Smirnov): the largest distance."""
    found = kstest(norm.cdf(z), "uniform")
    return float(found.statistic), 0.0, float(found.pvalue)


def pit_counts(z: Array, bins: int = 10) -> list[int]:
    """Counts of the probability integral transform in equal bins; what is not finite is left out."""
    counts, _ = np.histogram(norm.cdf(z[np.isfinite(z)]), bins, (0.0, 1.0))
    return [int(count) for count in counts]


def series_checks(
    flight: str, what: str, z: Array, dt: float, frequencies: Mapping[str, float], pit: bool = True
) -> list[Check]:
    """Checks of one series of numbers that are standard normal under the model.

    Args:
        flight: Name of the flight.
        what: What the series is.
        z: Standardised innovations of an output (T,); samples that are not finite were not recorded.
        dt: Time between samples [s].
        frequencies: Name and frequency [Hz] of modes.
        pit: Whether the probability integral transform is tested.
    """
    known = z[np.isfinite(z)]
    if known.size < 4 * LAGS:
        return []
    tests = {"mean": mean_test(known), "mean square": size_test(known), "autocorrelation": autocorrelation_test(known)}
    for name, frequency in frequencies.items():
        found = power_test(known, dt, frequency)
        if found is not None:
            tests[f"power near {frequency:.2g} Hz ({name})"] = found
    if pit:
        tests["PIT distance"] = pit_test(known)
    return [Check(flight, what, name, *values) for name, values in tests.items()]


def draws_checks(flight: str, what: str, draws: Array, dt: float, frequencies: Mapping[str, float]) -> list[Check]:
    """Checks of draws of standardised process noise (T, B), given the record.

    Each draw has its own p-value. Twice their mean is a p-value whatever their dependence (Rueschendorf 1982).
    """
    several = [series_checks(flight, what, draws[:, i], dt, frequencies, pit=False) for i in range(draws.shape[1])]
    made = []
    for same in zip(*several, strict=True):
        p = min(1.0, 2.0 * float(np.mean([one.p for one in same])))
        made.append(same[0]._replace(value=float(np.mean([one.value for one in same])), p=p))
    return made


def prior_check(flight: str, what: str, z: float) -> Check:
    """Prior-data conflict: distance of an estimate from its prior [its standard deviations before the data]."""
    return Check(flight, what, FROM_PRIOR, float(z), 0.0, _two_sided(z))


def mean_check(flight: str, what: str, mean: float, spread: float) -> Check:
    """Time mean of an estimated disturbance, and its standard deviation as stated, in the disturbance's unit."""
    return Check(flight, what, "time mean", float(mean), 0.0, _two_sided(mean / spread))


def error_check(flight: str, what: str, unit: str, estimate: float, p: float, matters: bool) -> Check:
    """Estimated size of an error of a record or vehicle that the fit takes not to be there."""
    return Check(flight, what, ESTIMATED, float(estimate), 0.0, float(p), unit, matters)


def least(checks: Iterable[Check]) -> list[Check]:
    """By p-value, the smallest first."""
    return sorted(checks, key=lambda one: one.p)


def missed(checks: Sequence[Check], bound: float = BOUND) -> list[Check]:
    """Checks that matter and whose p-value is below the bound, after Bonferroni's correction for their number."""
    return [one for one in least(checks) if one.matters and one.p * len(checks) < bound]


def verdict(checks: Sequence[Check], bound: float = BOUND) -> dict[str, Any]:
    """The check of a run: passed, smallest corrected p-value, bound and words."""
    off, first = missed(checks, bound), least(one for one in checks if one.matters)
    value = min(1.0, first[0].p * len(checks)) if first else 1.0
    counts = f"{len(checks)} predictive statistics"
    if off:
        named = "; ".join(f"{one.words} on {one.flight}" for one in off[:SHOWN])
        more = f"; and {len(off) - SHOWN} more" if len(off) > SHOWN else ""
        of_priors = all(one.statistic == FROM_PRIOR for one in off)
        fault = "is not what the priors say" if of_priors else "is not one that the model makes"
        detail = f"the record {fault}: {named}{more} ({len(off)} of {counts})"
    else:
        detail = f"smallest p-value of {counts}, corrected for their number (Bonferroni)"
    return {"passed": not off, "value": value, "bound": bound, "detail": detail}
