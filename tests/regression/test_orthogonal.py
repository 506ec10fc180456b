from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import OrthogonalMatchingPursuit, orthogonal_mp
from tests.twins import naive_mof as twin

from bayeschute.core.errors import InputError
from bayeschute.regression.orthogonal import orthonormal, select

# sqrt(mse), dmse, perr, R2, pe, F of the print-out in section 7.3 of NASA/TM-2019-220410
PRINTED = np.array(
    [
        (1.503e-01, -6.952e-01, 17.74, 0.00, 1.508e-01, 152.75),
        (4.249e-02, -2.079e-02, 5.01, 92.01, 4.590e-02, 4.57),
        (2.590e-02, -1.134e-03, 3.06, 97.03, 3.352e-02, 0.25),
        (2.344e-02, -1.213e-04, 2.77, 97.57, 3.396e-02, 0.03),
        (2.180e-02, -7.414e-05, 2.57, 97.90, 3.507e-02, 0.02),
        (2.078e-02, -4.344e-05, 2.45, 98.09, 3.658e-02, 0.01),
        (2.016e-02, -2.549e-05, 2.38, 98.20, 3.825e-02, 0.01),
        (1.984e-02, -1.258e-05, 2.34, 98.26, 4.002e-02, 0.00),
        (1.902e-02, -3.197e-05, 2.25, 98.40, 4.148e-02, 0.01),
        (1.867e-02, -1.302e-05, 2.20, 98.46, 4.311e-02, 0.00),
        (1.823e-02, -1.624e-05, 2.15, 98.53, 4.465e-02, 0.00),
        (1.810e-02, -4.938e-06, 2.14, 98.55, 4.625e-02, 0.00),
        (1.792e-02, -6.592e-06, 2.11, 98.58, 4.779e-02, 0.00),
        (1.780e-02, -4.308e-06, 2.10, 98.60, 4.930e-02, 0.00),
        (1.768e-02, -3.916e-06, 2.09, 98.62, 5.077e-02, 0.00),
        (1.759e-02, -3.486e-06, 2.08, 98.63, 5.220e-02, 0.00),
        (1.737e-02, -7.685e-06, 2.05, 98.67, 5.356e-02, 0.00),
        (1.728e-02, -2.829e-06, 2.04, 98.68, 5.492e-02, 0.00),
        (1.723e-02, -1.958e-06, 2.03, 98.69, 5.626e-02, 0.00),
        (1.713e-02, -3.321e-06, 2.02, 98.70, 5.756e-02, 0.00),
    ]
)
REPORT_N, REPORT_SIGMA = 1508, 0.0675


def correlated(rng, rows, columns, rank=6):
    shared = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, columns))
    return shared + 0.3 * rng.normal(size=(rows, columns)) + rng.normal(size=columns)


def report_path():
    """Orthogonal columns that give the report's dmse in the report's order."""
    rng = np.random.default_rng(5)
    Q, _ = np.linalg.qr(np.column_stack([np.ones(REPORT_N), rng.normal(size=(REPORT_N, 20))]))
    a = np.sqrt(-PRINTED[:, 1] * REPORT_N)
    z = Q[:, :20] @ a + Q[:, 20] * PRINTED[-1, 0] * np.sqrt(REPORT_N)
    return select(Q[:, :20], z, noise_variance=REPORT_SIGMA**2, penalty_factor=2.0, forced=range(20))


def free(selection, **changes):
    """The same path, with nothing forced."""
    return replace(selection, forced=0, **changes).with_ceiling(selection.ceiling)


@pytest.mark.parametrize("seed", range(8))
def test_path_matches_refitting_every_candidate(seed):
    rng = np.random.default_rng(seed)
    X = correlated(rng, 80, 14)
    z = X[:, [2, 7, 11]] @ [1.0, -2.0, 0.5] + rng.normal(size=80)
    s = select(X, z, sigma_max2=3.0, penalty_factor=1.0)
    naive = twin.naive_mof(X, z, 3.0 / 80, 14)
    assert list(s.order) == naive["order"]
    np.testing.assert_allclose(s.mean_squared_errors(), naive["mse"], rtol=1e-9)
    np.testing.assert_allclose([row.pse for row in s.rows], naive["pse"][1:], rtol=1e-9)
    assert s.minimum == naive["minimum"]
    np.testing.assert_allclose(s.estimate, naive["estimate"], rtol=1e-8)
    assert s.exhausted and s.certain


def test_back_transformation_is_the_refit_at_every_row():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 1, 200)
    X = np.column_stack([t**k for k in range(9)])
    z = np.exp(t) + 1e-3 * rng.normal(size=200)
    s = select(X, z, sigma_max2=1e-6)
    for n in range(1, len(s.order) + 1):
        direct = np.linalg.lstsq(X[:, list(s.order[:n])], z, rcond=None)[0]
        fitted = X[:, list(s.order[:n])] @ s.coefficients(n)
        np.testing.assert_allclose(fitted, X[:, list(s.order[:n])] @ direct, atol=1e-9)
    assert s.coefficients(0).size == 0
    with pytest.raises(InputError, match="length of the path"):
        s.coefficients(99)


def test_row_columns_are_what_they_say():
    rng = np.random.default_rng(2)
    X = correlated(rng, 300, 10)
    X[:, 0] = 1.0
    z = 5.0 + X[:, 3] + 0.4 * rng.normal(size=300)
    s = select(X, z, noise_variance=0.16, penalty_factor=2.0, indices=[f"i{j}" for j in range(10)])
    before = float(np.mean(z**2))
    for n, row in enumerate(s.rows, 1):
        assert row.n == n and row.term == s.names[s.order[n - 1]] and row.index == f"i{s.order[n - 1]}"
        assert row.dmse < 0 and row.mse == pytest.approx(before + row.dmse, rel=1e-9)
        assert row.pse == pytest.approx(row.mse + 2 * 25 * 0.16 * n / 300)
        assert row.pe == pytest.approx(np.sqrt(row.pse))
        assert row.perr == pytest.approx(100 * np.sqrt(row.mse / np.mean(z**2)))
        assert row.r2 == pytest.approx(100 * (1 - row.mse / np.var(z)))
        assert row.f_ratio == pytest.approx(-row.dmse * 300 / (300 - n) / 0.16)
        # the last candidate's remainder has factor 1 on itself, so a is its coefficient in the model of n terms
        assert row.a == pytest.approx(s.coefficients(n)[-1], rel=1e-9)
        before = row.mse


def test_report_print_out_is_reproduced():
    s = report_path()
    rows = np.array([(np.sqrt(r.mse), r.dmse, r.perr, r.r2, r.pe, r.f_ratio) for r in s.rows])
    np.testing.assert_allclose(rows[:, 0], PRINTED[:, 0], rtol=6e-4)
    np.testing.assert_allclose(rows[:, 1], PRINTED[:, 1], rtol=1e-9)
    np.testing.assert_allclose(rows[:, 2], PRINTED[:, 2], atol=0.011)
    np.testing.assert_allclose(rows[:, 3], PRINTED[:, 3], atol=0.011)
    np.testing.assert_allclose(rows[:, 4], PRINTED[:, 4], rtol=1e-3)
    np.testing.assert_allclose(rows[:, 5], PRINTED[:, 5], rtol=2e-3, atol=0.006)
    assert free(s).minimum == 3
    text = s.print_out(20)
    assert "-1.134e-03" in text and len(text.splitlines()) == 22


def test_penalty_per_term_is_constant_in_every_row():
    s = report_path()
    per_term = [(r.pe**2 - r.mse) / r.n for r in s.rows]
    np.testing.assert_allclose(per_term, 1.5099e-4, rtol=1e-3)
    np.testing.assert_allclose(per_term, per_term[0], rtol=1e-9)
    printed = (PRINTED[:, 4] ** 2 - PRINTED[:, 0] ** 2) / np.arange(1, 21)
    np.testing.assert_allclose(printed[1:], 1.5099e-4, rtol=0.01)


def test_structure_follows_sigma_max_past_local_minima():
    s = free(report_path())
    assert s.at(25 * 0.0166**2).n == 11
    assert free(s, penalty_factor=1.0).at(25 * 0.0166**2).n == 17  # rows 14 to 16 alone would not pay
    assert s.sensitivity([25 * 0.0675**2, 25 * 0.0166**2])[0].n == 3
    every = s.sensitivity()
    counts = [structure.n for structure in every]
    assert counts == sorted(counts, reverse=True) and counts[0] == 20 and counts[-1] == 0
    for left, right in zip(every[:-1], every[1:], strict=True):
        assert left.high == pytest.approx(right.low)
        assert s.at(left.sigma_max2).n == left.n and left.low <= left.sigma_max2 <= left.high
    assert every[-1].high == np.inf and every[0].low == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_matching_pursuit_agrees_where_theory_says(seed):
    rng = np.random.default_rng(seed)
    X = correlated(rng, 60, 9)
    z = rng.normal(size=60) + X[:, 4]
    assert select(X, z).order[0] == twin.orthogonal_matching_pursuit(X, z, 1)[0]
    Q, _ = np.linalg.qr(X)
    Q = Q * rng.uniform(0.1, 10.0, size=9)
    assert list(select(Q, z, max_terms=9).order) == twin.orthogonal_matching_pursuit(Q, z, 9)
    # noise-free and nearly orthogonal: both find the true columns first
    wide = rng.normal(size=(400, 30))
    truth = wide[:, [3, 17, 25]] @ [1.0, -1.5, 2.0]
    s = select(wide, truth, sigma_max2=1e-9)
    assert (
        set(s.terms) == {"x4", "x18", "x26"} == {f"x{j + 1}" for j in twin.orthogonal_matching_pursuit(wide, truth, 3)}
    )
    assert s.exhausted and s.minimum == 3
    np.testing.assert_allclose(sorted(s.estimate), [-1.5, 1.0, 2.0], rtol=1e-10)


def pursued(X, z, terms):
    """Order in which scikit-learn's orthogonal matching pursuit takes columns: of length 1, as it wants them."""
    scaled = X / np.linalg.norm(X, axis=0)
    sets = [set(np.flatnonzero(orthogonal_mp(scaled, z, n_nonzero_coefs=n))) for n in range(1, terms + 1)]
    order = [int(j) for before, now in zip([set(), *sets], sets, strict=False) for j in now - before]
    assert len(order) == terms
    return order


@pytest.mark.parametrize("seed", range(5))
def test_scikit_learn_agrees_where_theory_says(seed):
    rng = np.random.default_rng(100 + seed)
    X = correlated(rng, 80, 10)
    z = X[:, [1, 6]] @ [1.0, -0.7] + rng.normal(size=80)
    # Nothing is chosen yet at the first step: both take the column that z leans on most.
    assert select(X, z, max_terms=1).order[0] == pursued(X, z, 1)[0]
    # Orthogonal columns: nothing has to be taken off a candidate, so both orders are that of |x . z|/|x|.
    Q, _ = np.linalg.qr(X)
    Q = Q * rng.uniform(0.1, 10.0, size=10)
    order = pursued(Q, z, 10)
    assert list(select(Q, z, max_terms=10).order) == order
    assert order == list(np.argsort(-np.abs(Q.T @ z) / np.linalg.norm(Q, axis=0)))
    # The same set has the same least squares, so where orders agree so do coefficients.
    length = np.linalg.norm(Q, axis=0)
    model = OrthogonalMatchingPursuit(n_nonzero_coefs=4, fit_intercept=False).fit(Q / length, z)
    coefficients = select(Q, z, max_terms=10).coefficients(4)
    np.testing.assert_allclose(coefficients, (model.coef_ / length)[order[:4]], rtol=1e-9)


def test_matching_pursuit_differs_where_candidates_are_correlated():
    rng = np.random.default_rng(11)
    X = correlated(rng, 60, 9)
    z = rng.normal(size=60) + X[:, 4]
    order = twin.orthogonal_matching_pursuit(X, z, 9)
    assert order != list(select(X, z).order)  # MOF compares what remains of a candidate, not the whole of it
    cost = 2.0 * 0.5 / 60
    best = select(X, z, sigma_max2=0.5)
    assert best.rows[1].pse <= twin.predicted_squared_errors(X, z, order, cost)[2]


def test_copies_zeros_and_combinations_are_dropped_and_listed():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(50, 2))
    single = x[:, 0].astype(np.float32).astype(float)
    X = np.column_stack([np.ones(50), x, np.zeros(50), 3.0 * np.ones(50), x[:, 0] - 2 * x[:, 1], single])
    z = 1.0 + x @ [2.0, 1.0] + 0.1 * rng.normal(size=50)
    s = select(X, z, list("1abz3cs"), noise_variance=0.01)
    assert len(s.order) == 3 and s.exhausted
    assert {name for name, _ in s.dropped} | set(s.terms) == set("1abz3cs")
    assert ("z", 0) in s.dropped and s.order.count(0) + s.order.count(4) == 1
    after = dict(s.dropped)
    for copies in ((0, 4), (1, 6)):  # a copy is dropped by the step that takes the other
        taken, gone = sorted(copies, key=lambda j: j not in s.order)
        assert after["1abz3cs"[gone]] == s.order.index(taken) + 1


def test_more_candidates_than_rows():
    rng = np.random.default_rng(4)
    X = rng.normal(size=(30, 100))
    z = 3.0 * X[:, 40] + 0.1 * rng.normal(size=30)
    s = select(X, z, noise_variance=0.01)
    assert s.order[0] == 40 and len(s.order) <= 30 and s.exhausted
    assert s.rows[-1].mse < 1e-20


def test_scale_of_columns_and_order_of_rows_change_nothing():
    rng = np.random.default_rng(6)
    X = correlated(rng, 100, 12)
    z = X[:, 1] - X[:, 5] + rng.normal(size=100)
    s = select(X, z, sigma_max2=2.0)
    scale = 10.0 ** rng.integers(-6, 7, size=12)
    shuffled = rng.permutation(100)
    other = select((X * scale)[shuffled], z[shuffled], sigma_max2=2.0)
    assert other.order == s.order and other.minimum == s.minimum
    np.testing.assert_allclose(other.estimate * scale[list(s.selected)], s.estimate, rtol=1e-8)


def test_nearly_dependent_candidates_keep_their_digits():
    rng = np.random.default_rng(7)
    base = rng.normal(size=400)
    tiny = rng.normal(size=400)
    X = np.column_stack([base, base + 1e-5 * tiny, rng.normal(size=(400, 3))])
    z = base + 1e-5 * tiny * 50 + 1e-6 * rng.normal(size=400)
    s = select(X, z, sigma_max2=1e-11)
    assert {0, 1} <= set(s.selected)
    coefficients = dict(zip(s.selected, s.estimate, strict=True))
    assert coefficients[1] == pytest.approx(50, rel=1e-2) and coefficients[0] == pytest.approx(-49, rel=1e-2)


def test_short_path_says_that_it_is_not_certain():
    rng = np.random.default_rng(8)
    X = rng.normal(size=(200, 50))
    z = X @ np.ones(50) + rng.normal(size=200)
    assert not select(X, z, noise_variance=0.01, max_terms=5).certain
    assert select(X, z, noise_variance=0.01).certain
    assert select(X, z, sigma_max2=1e6, max_terms=5).certain


def test_an_orthonormal_basis_keeps_its_digits():
    rng = np.random.default_rng(14)
    base = rng.normal(size=(200, 1))
    columns = base + 1e-7 * rng.normal(size=(200, 5)) * [0, 1, 10, 1e3, 1e5]
    Q = orthonormal(columns)
    np.testing.assert_allclose(Q.T @ Q, np.eye(5), atol=1e-13)
    np.testing.assert_allclose(Q @ (Q.T @ columns), columns, atol=1e-13)
    assert orthonormal(columns[:, :0]).shape == (200, 0)


def test_nothing_is_kept_from_noise():
    rng = np.random.default_rng(9)
    s = select(rng.normal(size=(500, 20)), rng.normal(size=500), noise_variance=1.0)
    assert s.minimum == 0 and s.terms == () and s.estimate.size == 0


def test_forced_terms_come_first_and_stay():
    rng = np.random.default_rng(10)
    X = rng.normal(size=(100, 6))
    z = 2.0 * X[:, 2] + 0.1 * rng.normal(size=100)
    s = select(X, z, noise_variance=0.01, forced=[5])
    assert s.selected == (5, 2) and s.sensitivity()[-1].terms == ("x6",)
    with pytest.raises(InputError, match="combination of earlier"):
        select(np.column_stack([X, X[:, 0]]), z, forced=[0, 6])


def test_groups_make_the_default_rule_blind_to_the_axes():
    rng = np.random.default_rng(12)
    vectors, force = rng.normal(size=(5, 2, 150)), rng.normal(size=(2, 150)) + np.array([[4.0], [1.0]])
    which = np.repeat([0, 1], 150)

    def at_angle(angle):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        X = np.stack([(turn @ v).ravel() for v in vectors], axis=1)
        return select(X, (turn @ force).ravel(), groups=which)

    first, other = at_angle(0.0), at_angle(1.1)
    assert other.order == first.order
    assert other.ceiling.value == pytest.approx(first.ceiling.value, rel=1e-12)
    np.testing.assert_allclose([r.r2 for r in other.rows], [r.r2 for r in first.rows], atol=1e-9)


def test_rows_with_missing_values_are_left_out():
    rng = np.random.default_rng(13)
    X, z = rng.normal(size=(60, 4)), rng.normal(size=60)
    X[3, 1], z[10] = np.nan, np.nan
    s = select(X, z, sigma_max2=0.5)
    keep = np.setdiff1d(np.arange(60), [3, 10])
    direct = select(X[keep], z[keep], sigma_max2=0.5)
    assert s.samples == 58 and s.order == direct.order
    np.testing.assert_array_equal(s.mean_squared_errors(), direct.mean_squared_errors())


@pytest.mark.parametrize(
    ("X", "z", "options"),
    [
        (np.ones((3, 2)), np.ones(4), {}),
        (np.ones(3), np.ones(3), {}),
        (np.ones((3, 0)), np.ones(3), {}),
        (np.full((3, 1), np.nan), np.arange(3.0), {}),
        (np.array([[1.0], [np.inf], [2.0]]), np.arange(3.0), {}),
        (np.ones((3, 1)), np.array([0.0, np.inf, 1.0]), {}),
        (np.ones((3, 1), dtype=complex), np.arange(3.0), {}),
        ([["a"], ["b"], ["c"]], np.arange(3.0), {}),
        ([[1.0], [1.0, 2.0], [1.0]], np.arange(3.0), {}),
        (np.ones((3, 1)) * 1e200, np.arange(3.0), {}),
        (np.ones((3, 2)), np.arange(3.0), {"names": ["a", "a"]}),
        (np.ones((3, 2)), np.arange(3.0), {"indices": ["1"]}),
        (np.ones((3, 2)), np.arange(3.0), {"forced": [2]}),
        (np.ones((3, 2)), np.arange(3.0), {"penalty_factor": 0.0}),
        (np.ones((3, 2)), np.arange(3.0), {"drop_tolerance": 0.0}),
        (np.ones((3, 2)), np.arange(3.0), {"max_terms": 0}),
        (np.ones((3, 2)), np.arange(3.0), {"groups": [1, 2]}),
    ],
)
def test_bad_input_is_refused(X, z, options):
    with pytest.raises(InputError):
        select(X, z, **options)
