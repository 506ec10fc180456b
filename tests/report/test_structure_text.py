"""The search for a structure as plain text: what a row, a prediction and a rival say."""

from __future__ import annotations

from bayeschute.report import structure_text as module
from bayeschute.report.structure_text import AS_GOOD, MOST_RANKED, grid, print_out


def row(n, **values):
    kept = {"n": n, "index": str(n), "mse": 0.04, "dmse": -1e-3, "perr": 3.0, "r2": 0.5, "pe": 0.3, "f_ratio": 9.0}
    return kept | {"term": f"t{n}"} | values


def test_a_mean_squared_error_is_told_by_its_root_and_nothing_below_zero():
    _, first, second = print_out([row(1), row(2, mse=-1e-20, r2=None, f_ratio=None)], 1)
    assert first.split()[2] == "2.000e-01" and second.split()[2] == "0.000e+00"
    assert second.split()[5] == "-" and second.split()[8] == "-"
    assert "<- minimum PSE" in first and "<-" not in second


def test_a_long_ranking_is_cut_and_a_lower_error_beyond_the_cut_still_counts():
    rows = [row(n, pe=1.0 - 0.01 * n) for n in range(1, MOST_RANKED + 6)]
    lines = print_out(rows, MOST_RANKED)
    assert len(lines) == 1 + MOST_RANKED and lines[-1].endswith("<- minimum PSE with the required terms")
    assert len({line.index("  t") for line in print_out([row(1), row(2, index="0112233445")], 1)}) == 1


def test_columns_are_as_wide_as_their_widest_cell():
    lines = grid(["a", "head"], [["long name", "1"], ["b", "12345"]])
    assert lines == ["a           head", "long name      1", "b          12345"]


def predicted(**check):
    return module._predicted(check)


def test_a_prediction_is_as_good_as_its_terms_allow_up_to_a_twentieth():
    assert predicted(rms_ratio=1.2 * AS_GOOD, least_ratio=1.2).endswith("as good as these terms allow")
    assert "as good" not in predicted(rms_ratio=1.2 * AS_GOOD + 1e-9, least_ratio=1.2)
    assert predicted(rms_ratio=None, least_ratio=1.2, expected_ratio=1.5).startswith(
        "residual - times that of the fit; 1.20 with these terms refitted; 1.50 expected from their standard errors"
    )
    told = predicted(rms_ratio=1.4, true_ratio=1.1, bias=0.02, without={"term": "q", "rms_ratio": 1.3})
    assert (
        told == "residual 1.40 times that of the fit; 1.10 with the true coefficients; mean error +0.02; 1.30 without q"
    )


def test_only_a_term_that_is_missed_and_has_a_rival_is_explained():
    term = {
        "term": "alpha",
        "share": 0.75,
        "rival": "q",
        "rival_share": 0.2,
        "rival_correlation": -0.987,
        "rival_chance": 0.1,
    }
    entry = {"true": [term, term | {"term": "kept", "share": 1.0}, term | {"term": "alone", "rival": None}]}
    (line,) = module._reasons(entry)
    assert line == (
        "alpha, selected in 75 %: its partial correlation with q (selected in 20 %) given the other terms is -0.987; "
        "noise makes the wrong one fit better with probability 10 %"
    )
