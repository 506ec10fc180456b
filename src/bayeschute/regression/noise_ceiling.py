"""The noise ceiling sigma_max^2 of the predicted squared error, and the rules that give it (report, 6.3.6-11, -12)."""

from __future__ import annotations

from typing import NamedTuple

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.problem import positive

REPORT_SAFETY = 25.0


class Ceiling(NamedTuple):
    """The sigma_max^2 of the predicted squared error and where it comes from.

    Attributes:
        value: sigma_max^2 [unit of z, squared].
        rule: ``"fixed"``, ``"smoothing"``, ``"25 sigma^2"`` or ``"default"``.
        noise_variance: sigma^2 that the F ratio divides by [unit of z, squared].
        sentence: The rule in words.
    """

    value: float
    rule: str
    noise_variance: float
    sentence: str


def noise_ceiling(
    rule: str | None,
    *,
    variance: float | None = None,
    sigma_max2: float | None = None,
    noise_variance: float | None = None,
    safety: float = REPORT_SAFETY,
) -> Ceiling:
    """The sigma_max^2 of the predicted squared error (6.3.6-11, -12).

    Rules: "fixed" takes sigma_max2 as given. "smoothing" takes the noise variance that global Fourier smoothing left,
    with no safety factor. "25 sigma^2" is the report's: that variance times `safety`. "default" is the variance of the
    response about its mean, the bound when nothing is known of the noise: a model that only knows the mean errs by
    that much. The F ratio needs a sigma^2: the noise variance, or sigma_max^2/safety where none is given.

    Args:
        rule: One of the four; None picks by what is given, in the order fixed, 25 sigma^2, default.
        variance: Variance of the response about its mean, for "default".
        sigma_max2: For "fixed".
        noise_variance: For "smoothing" and "25 sigma^2".
        safety: Factor on the noise variance; the report's 25 is five standard deviations.

    Returns:
        The value and the rule in words.

    Raises:
        InputError: For an unknown rule, or one whose number is missing or not above zero.
    """
    if rule is None:
        rule = "fixed" if sigma_max2 is not None else "default" if noise_variance is None else "25 sigma^2"
    positive("sigma_max safety", safety)
    source = {
        "fixed": (sigma_max2, 1.0, "sigma_max2", "as given"),
        "smoothing": (noise_variance, 1.0, "noise_variance", "noise variance from smoothing"),
        "25 sigma^2": (noise_variance, safety, "noise_variance", f"{safety:g} x noise variance from smoothing"),
        "default": (variance, 1.0, "the variance of z", "variance of the response about its mean"),
    }
    if rule not in source:
        raise InputError(Fault("sigma_max rule", repr(rule), "one of " + ", ".join(map(repr, source))))
    value, factor, name, words = source[rule]
    if value is None:
        raise InputError(Fault(f"sigma_max rule {rule!r}", f"no {name}", f"{name} as a number"))
    positive(name, value)
    if noise_variance is not None:
        positive("noise_variance", noise_variance)
    sigma_max2 = float(value) * factor
    noise = float(noise_variance) if noise_variance is not None else sigma_max2 / safety
    return Ceiling(sigma_max2, rule, noise, f"sigma_max^2 = {sigma_max2:.4g}, {words}")
