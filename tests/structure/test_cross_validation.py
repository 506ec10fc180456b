from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.equation_error import fit
from bayeschute.regression.stacked import stack_components
from bayeschute.structure.cross_validation import predict_record


def record(rng, n=2000, scale=1.0, slope=2.0):
    X = np.column_stack([np.ones(n), scale * rng.uniform(-1, 1, size=n)])
    return X, X @ [1.0, slope] + 0.2 * rng.normal(size=n)


def test_the_same_law_predicts_as_well_as_it_fits():
    rng = np.random.default_rng(0)
    f = fit(*record(rng))
    test = predict_record(f, *record(rng), label="Main 8")
    assert test.label == "Main 8" and test.samples == 2000
    assert test.rms_ratio == pytest.approx(1.0, abs=0.05) and test.r2 > 0.95
    assert abs(test.bias) < 0.02 and test.extrapolated < 0.01 and test.theil.coefficient < 0.1


def test_another_law_is_seen():
    rng = np.random.default_rng(1)
    f = fit(*record(rng))
    X, z = record(rng, slope=-2.0)
    test = predict_record(f, X, z)
    assert test.rms_ratio > 5 and test.r2 < 0
    assert test.rms == pytest.approx(np.sqrt(np.mean((z - X @ f.estimate) ** 2)))
    np.testing.assert_allclose(test.residual, z - X @ f.estimate)


def test_what_data_are_more_than_foretold_is_a_positive_bias():
    rng = np.random.default_rng(5)
    f = fit(*record(rng))
    X, z = record(rng)
    assert predict_record(f, X, z + 0.3).bias == pytest.approx(0.3, abs=0.02)


def test_extrapolation_is_told():
    rng = np.random.default_rng(2)
    f = fit(*record(rng))
    assert predict_record(f, *record(rng, scale=2.0)).extrapolated == pytest.approx(0.5, abs=0.05)


def test_gaps_stay_gaps():
    rng = np.random.default_rng(3)
    f = fit(*record(rng))
    X, z = record(rng)
    z[5], X[9, 1] = np.nan, np.nan
    test = predict_record(f, X, z)
    assert test.samples == 1998 and np.flatnonzero(np.isnan(test.residual)).tolist() == [5, 9]


def test_components_have_means_of_their_own():
    rng = np.random.default_rng(4)
    terms = rng.normal(size=(2, 400, 2, 1))
    stacks = [stack_components(t, 0.7 * t[..., 0] + 0.1 * rng.normal(size=(400, 2))) for t in terms]
    f = fit(stacks[0].X, stacks[0].z, ["e"], blocks=stacks[0].blocks, groups=stacks[0].groups)
    z = stacks[1].z + 3.0 * stacks[1].components  # so that the means of the two differ
    apart, together = (predict_record(f, stacks[1].X, z, components=c) for c in (stacks[1].components, None))
    assert apart.rms == together.rms and apart.r2 < together.r2
    test = predict_record(f, stacks[1].X, stacks[1].z, components=stacks[1].components)
    assert test.rms_ratio == pytest.approx(1.0, abs=0.15)


def test_wrong_columns_are_refused():
    rng = np.random.default_rng(5)
    f = fit(*record(rng), ["1", "alpha"])
    with pytest.raises(InputError, match="alpha"):
        predict_record(f, np.ones((5, 3)), np.ones(5))
    with pytest.raises(InputError):
        predict_record(f, np.full((5, 2), np.nan), np.ones(5))


def test_what_no_coefficients_of_these_terms_could_avoid():
    rng = np.random.default_rng(6)
    f = fit(*record(rng))
    X, z = record(rng, slope=1.6)
    z = z + 0.3 * rng.normal(size=z.size)  # a noisier record, and another law
    test = predict_record(f, X, z)
    own = np.linalg.lstsq(X, z, rcond=None)[0]
    assert test.least_ratio * f.rms == pytest.approx(np.sqrt(np.mean((z - X @ own) ** 2)))
    assert test.least_ratio == pytest.approx(np.hypot(0.2, 0.3) / 0.2, rel=0.05)
    # The error of a prediction is the least and, orthogonal to it, that of the coefficients.
    off = X @ (own - f.estimate)
    assert (test.rms_ratio**2 - test.least_ratio**2) * f.rms**2 == pytest.approx(np.mean(off**2), rel=1e-9)
    itself = predict_record(f, *record(np.random.default_rng(6)))
    assert itself.least_ratio == pytest.approx(itself.rms_ratio, rel=1e-12)


def test_what_the_errors_of_the_coefficients_lead_one_to_expect():
    """Over many pairs of short records, the mean squared prediction error is the expected one."""
    rng = np.random.default_rng(7)
    seen, expected = [], []
    for _ in range(300):
        X, z = record(rng, n=12)
        f = fit(X, z)
        f = replace(f, covariance=0.2**2 * np.linalg.inv(X.T @ X))
        test = predict_record(f, *record(rng, n=200))
        seen.append(test.rms**2 - 0.2**2)
        expected.append((test.expected_ratio**2 - 1.0) * f.rms**2)
    assert np.mean(seen) == pytest.approx(np.mean(expected), rel=0.15)
    assert np.mean(expected) > 0.1 * 0.2**2
