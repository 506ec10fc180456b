from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from bayeschute.core.errors import InputError
from bayeschute.prediction.binomial_limits import (
    clopper_pearson,
    jeffreys,
    wilks_confidence,
    wilks_failures,
    wilks_sample_size,
)


@pytest.mark.parametrize(
    ("share", "confidence", "sizes"),
    [(0.99865, 0.9, (1705, 2880, 3941)), (0.9973, 0.9, (852, 1440, 1970)), (0.95, 0.95, (59, 93, 124))],
)
def test_wilks_sizes_are_the_published_ones(share, confidence, sizes):
    assert tuple(wilks_sample_size(share, confidence, failures) for failures in range(3)) == sizes


def test_wilks_without_failures_is_the_closed_form():
    for share in (0.5, 0.9, 0.999):
        assert wilks_sample_size(share, 0.9) == int(np.ceil(np.log(0.1) / np.log(share)))


def test_wilks_size_is_the_least():
    for failures in (0, 3, 17):
        size = wilks_sample_size(0.97, 0.9, failures)
        assert wilks_confidence(size, 0.97, failures) >= 0.9 > wilks_confidence(size - 1, 0.97, failures)
        assert wilks_failures(size, 0.97, 0.9) == failures
    assert wilks_failures(58, 0.95, 0.95) == -1


def test_wilks_limit_covers_the_share_as_often_as_it_says():
    rng = np.random.default_rng(1)
    limits = np.sort(rng.random((4000, 93)), axis=1)[:, -2]  # one failure allowed at 95/95
    assert abs((limits > 0.95).mean() - wilks_confidence(93, 0.95, 1)) < 0.012


@pytest.mark.parametrize(("count", "total"), [(0, 30), (1, 30), (7, 30), (30, 30), (300, 4000)])
def test_clopper_pearson_is_scipys(count, total):
    limits = clopper_pearson(count, total, 0.9)
    reference = stats.binomtest(count, total).proportion_ci(0.9, method="exact")
    assert limits == pytest.approx((reference.low, reference.high), abs=1e-12)


def test_jeffreys_is_the_beta_posterior():
    assert jeffreys(7, 30, 0.9) == pytest.approx(stats.beta(7.5, 23.5).ppf([0.05, 0.95]), abs=1e-12)
    assert jeffreys(0, 30).low == 0.0
    assert jeffreys(30, 30).high == 1.0
    assert (
        clopper_pearson(7, 30).low < jeffreys(7, 30).low < 7 / 30 < jeffreys(7, 30).high < clopper_pearson(7, 30).high
    )


def test_nonsense_is_refused():
    with pytest.raises(InputError, match="strictly between 0 and 1"):
        wilks_sample_size(99.865, 0.9)
    with pytest.raises(InputError, match="whole number"):
        wilks_sample_size(0.9, 0.9, -1)
    with pytest.raises(InputError, match="31 of 30"):
        clopper_pearson(31, 30)
