"""Limits, verdicts and exceedance of landings counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.landing.decisions.decision import chance
from bayeschute.landing.decisions.requirements import Limit, Requirement, effective, exceedance, judge
from bayeschute.landing.measures import ROW
from bayeschute.prediction.binomial_limits import clopper_pearson


@pytest.fixture
def rows():
    made = np.zeros(6, ROW)
    made["draw"] = [0, 0, 0, 1, 1, 1]
    made["vertical_speed"] = [1.0, 2.0, 3.0, np.nan, 2.0, -np.inf]
    made["hang_angle"] = [0.1, 0.5, 0.1, 0.1, 0.1, 0.1]
    made["outcome"] = [0, 0, 0, 0, 1, 0]
    return made


@pytest.mark.parametrize(
    ("limit", "kept"),
    [
        (Limit("vertical_speed", 2.0), [True, True, False, False, False, False]),
        (Limit("vertical_speed", None, 2.0), [False, True, True, False, False, False]),
        (Limit("vertical_speed", 2.0, 1.5), [False, True, False, False, False, False]),
        (Limit("vertical_speed"), [True, True, True, False, False, False]),
    ],
)
def test_a_limit_itself_is_kept_and_failures_keep_none(rows, limit, kept):
    assert limit.kept(rows).tolist() == kept


def test_limits_hold_together_and_failures_are_counted(rows):
    both = Requirement("soft", (Limit("vertical_speed", 2.5), Limit("hang_angle", 0.2)), 0.5, 0.9)
    assert both.met(rows).tolist() == [True, False, False, False, False, False]
    judged = judge(both, rows)
    assert judged.chance.met == pytest.approx(1 / 6) and judged.chance.failed == 1 and judged.requirement is both
    assert judged.chance.draws == 2 and judged.chance.landings == 6


def test_what_failed_exceeds_every_threshold_and_columns_are_of_their_limits():
    rng = np.random.default_rng(0)
    rows = np.zeros(400, ROW)
    rows["draw"], rows["vertical_speed"] = np.arange(400) % 20, rng.normal(8.0, 1.0, 400)
    rows["outcome"][:11], rows["vertical_speed"][10] = 2, np.nan
    rows["vertical_speed"][:10] = 0.0  # what a failed landing says is not looked at
    rows["outcome"][10] = 0  # a landing without the quantity has failed, too
    table = exceedance(rows, "vertical_speed", [8.0, 1e6], confidence=0.8)
    x = np.where(np.arange(400) <= 10, np.inf, rows["vertical_speed"])
    for i, at in enumerate((8.0, 1e6)):
        found = chance(rows["draw"], x > at, 11, 0.8)
        limits = clopper_pearson(found.met * effective(found), effective(found), 0.8)
        assert table.loc[i].tolist() == [at, np.mean(x > at), found.low, found.high, *limits, 11]


def test_thresholds_span_what_was_seen():
    rows = np.zeros(1000, ROW)
    rows["draw"], rows["time"] = np.arange(1000) % 10, np.linspace(0.0, 1.0, 1000)
    rows["outcome"][-1], rows["time"][-1] = 1, 50.0
    at = exceedance(rows, "time")["threshold"]
    assert (
        len(at) == 21
        and at.iloc[0] == pytest.approx(0.005, abs=1e-4)
        and at.iloc[-1] == pytest.approx(0.9985, abs=1e-3)
    )
    rows["outcome"] = 1
    assert len(exceedance(rows, "time")) == 0


def _chance(met: float, epistemic: float, aleatory: float, draws: int, landings: int):
    return chance(np.arange(4) % 2, np.array([True, False, True, False])).__class__(
        met, 0.0, 1.0, 0.9, epistemic, aleatory, 0.0, draws, landings, 0, np.zeros(1), np.zeros(1), np.ones(1)
    )


def test_landings_count_for_what_they_tell_of_the_mean():
    """Var(mean) = epistemic variance / draws + aleatory variance / landings; independent landings have p (1 - p) / n."""
    assert effective(_chance(0.5, 0.0, 0.5, 10, 1000)) == pytest.approx(1000.0)
    assert effective(_chance(0.5, 0.3, 0.4, 50, 1000)) == pytest.approx(0.25 / (0.09 / 50 + 0.16 / 1000))
    assert effective(_chance(0.5, 0.5, 0.0, 50, 1000)) == 50.0
    assert effective(_chance(0.5, 0.6, 0.0, 50, 1000)) == 50.0  # not fewer than draws
    assert (
        effective(_chance(1.0, 0.1, 0.1, 50, 1000)) == 1000.0 and effective(_chance(0.5, 0.0, 0.0, 50, 1000)) == 1000.0
    )
