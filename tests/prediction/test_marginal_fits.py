from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from bayeschute.core.errors import InputError
from bayeschute.prediction.marginal_fits import FAMILIES, NO_EVIDENCE, Marginal, distribution, fit_marginal

RNG = np.random.default_rng(7)


def test_each_family_is_found_again():
    normal = fit_marginal(RNG.normal(-3.0, 0.2, 4000))
    assert normal.family == "normal"
    assert (normal.location, normal.scale) == pytest.approx((-3.0, 0.2), abs=0.02)

    lognormal = fit_marginal(RNG.lognormal(2.0, 0.5, 4000))
    assert lognormal.family == "lognormal"
    assert (lognormal.location, lognormal.scale) == pytest.approx((2.0, 0.5), abs=0.03)

    cut = fit_marginal(stats.truncnorm(-0.5, np.inf, loc=1.0, scale=2.0).rvs(6000, random_state=3), (0.0, math.inf))
    assert cut.family == "truncated normal"
    assert (cut.truncation_low, cut.location, cut.scale) == pytest.approx((0.0, 1.0, 2.0), abs=0.25)

    heavy = fit_marginal(5.0 + 0.1 * RNG.standard_t(3.0, 4000))
    assert heavy.family == "student-t"
    assert (heavy.location, heavy.scale, heavy.degrees_of_freedom) == pytest.approx((5.0, 0.1, 3.0), rel=0.15)


def test_a_truncated_normal_is_zero_outside_its_limits():
    made = distribution(Marginal("truncated normal", 1.0, 2.0, 0.5, 4.0))
    assert made.support() == pytest.approx((0.5, 4.0))
    assert made.pdf(2.0) / made.pdf(1.0) == pytest.approx(math.exp(-0.125))


def test_far_truncation_is_a_normal():
    fit = fit_marginal(RNG.normal(10.0, 0.1, 3000), (0.0, 50.0))
    assert fit.family == "normal"


def test_mirror_of_a_truncation():
    x = stats.truncnorm(-0.5, np.inf, loc=1.0, scale=2.0).rvs(3000, random_state=3)
    above, below = fit_marginal(x, (0.0, math.inf)), fit_marginal(-x, (-math.inf, 0.0))
    assert below.family == "truncated normal"
    assert below.location == pytest.approx(-above.location, abs=1e-3)
    assert below.scale == pytest.approx(above.scale, rel=1e-3)


def test_few_independent_draws_do_not_earn_a_richer_family():
    x = 0.1 * RNG.standard_t(6.0, 4000)
    assert fit_marginal(x).family == "student-t"
    assert fit_marginal(x, effective=20).family == "normal"


def test_the_family_kept_is_the_first_within_two_of_the_least_criterion():
    kept = [fit_marginal(np.random.default_rng(seed).standard_t(25.0, 2000)) for seed in range(30)]
    assert all(fit.aic <= fit.runner_up_aic + NO_EVIDENCE for fit in kept)
    behind = [fit for fit in kept if fit.aic > fit.runner_up_aic]
    assert behind, "some are kept though another has the lesser criterion"
    assert all(FAMILIES.index(fit.family) < FAMILIES.index(fit.runner_up) for fit in behind)


def test_criterion_is_scipys_likelihood():
    x = RNG.lognormal(0.0, 0.6, 500)
    fit = fit_marginal(x)
    assert fit.aic == pytest.approx(4 - 2 * distribution(fit).logpdf(x).sum(), abs=1e-6)
    assert fit.ks_distance == pytest.approx(stats.kstest(x, distribution(fit).cdf).statistic)
    t = fit_marginal(RNG.standard_t(3.0, 3000) * 4 + 1)
    assert t.family == "student-t"


def test_constant_and_bad_draws():
    assert fit_marginal(np.full(50, 3.0)).family == "constant"
    with pytest.raises(InputError, match="1 not finite"):
        fit_marginal(np.r_[np.ones(30), np.nan])
    with pytest.raises(InputError, match="bounds"):
        fit_marginal(RNG.normal(size=100), (0.0, 1.0))
