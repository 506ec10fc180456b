"""Results of rank tests: uniform ranks pass, moved ones do not, and failures are told."""

from __future__ import annotations

import numpy as np

from bayeschute.calibration.rank_tables import rank_lines, summarise_ranks


def rows(count, power=1.0):
    rng = np.random.default_rng(1)
    for seed in range(count):
        u = rng.uniform(size=2)
        ranks, spoiled = ({n: int(99 * v**p) for n, v in zip("ab", u, strict=True)} for p in (power, 2.0))
        yield {"seed": seed, "ok": True, "ranks": ranks, "spoiled": spoiled, "redrawn": 1}


def test_uniform_ranks_pass_and_spoiled_ones_fail():
    made = summarise_ranks([*rows(200), {"seed": 9, "ok": False, "error": "lost"}], 99, 0.3)
    assert made["passed"] is True and made["spoiled"]["passed"] is False
    assert made["replicates"] == 200 and made["failed"] == {"9": "lost"} and made["redrawn"] == 200
    text = "\n".join(rank_lines(made))
    assert "200 replicates, 1 failed" in text and "All ranks are uniform; the spoiled draws fail, as they must" in text


def test_ranks_that_are_not_uniform_fail():
    made = summarise_ranks(list(rows(200, power=3.0)), 99, 0.3)
    assert made["passed"] is False and "NOT all ranks are uniform" in rank_lines(made)[-1]


def test_no_replicate_is_no_pass():
    made = summarise_ranks([{"seed": 9, "ok": False, "error": "lost"}], 99, 0.3)
    assert made["passed"] is False and made["quantities"] == {}
