"""Answers to questions about landings: the most important first, and what drops are ranked by."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from bayeschute.api.landing.landing_answers import DropRanking, Placard, RareFailures, Sensitivity
from bayeschute.core.errors import InputError

SHARES = pd.DataFrame(
    [
        ("hang_angle", "first", "winds", 0.9, 0.01),
        ("hang_angle", "total", "winds", 0.3, 0.01),
        ("hang_angle", "total", "gusts", 0.6, 0.02),
        ("time", "total", "winds", 0.1, 0.03),
        ("time", "shapley", "mass", 0.4, np.nan),
    ],
    columns=["quantity", "kind", "source", "share", "standard_error"],
)


def test_total_shares_are_told_the_greatest_first_with_their_own_errors():
    assert Sensitivity(SHARES).words == [
        "hang_angle, total shares: gusts 0.60 +- 0.02, winds 0.30 +- 0.01", "time, total shares: winds 0.10 +- 0.03",
    ]  # fmt: skip


def test_one_quantity_and_one_kind_are_drawn():
    widths = [bar.get_width() for bar in Sensitivity(SHARES).plot().patches]
    assert widths == [0.3, 0.6]
    axes = Sensitivity(SHARES).plot("time", "shapley")
    assert [bar.get_width() for bar in axes.patches] == [0.4] and axes.get_title("left") == "time: what drives it"
    with pytest.raises(InputError, match="one of hang_angle, time"):
        Sensitivity(SHARES).plot("hang_angle", "shapley")


def test_what_is_the_same_in_all_landings_is_said_to_be_driven_by_nothing():
    same = Sensitivity(SHARES.assign(share=SHARES["share"].where(SHARES["quantity"] != "time")))
    assert same.words[1] == "time: the same in all landings, so that nothing drives it"
    axes = same.plot("time")
    assert not axes.patches and [t.get_text() for t in axes.texts] == ["the same in all landings"]
    assert axes.get_title("left") == "time: what drives it"


def test_a_posterior_with_failed_checks_is_doubted_in_words_and_in_the_table():
    doubted = Sensitivity(SHARES, failed_checks=("rhat", "<mode>"))
    assert repr(doubted).splitlines()[-1] == "no level of trust, failed checks: rhat, <mode>"
    assert "failed checks: rhat, &lt;mode&gt;</p>" in doubted._repr_html_()
    assert "trust" not in repr(Sensitivity(SHARES)) + Sensitivity(SHARES)._repr_html_()


def test_a_rare_failure_is_told_with_its_variation_and_its_cost():
    found = {"soft": SimpleNamespace(probability=1.25e-5, variation=0.31, evaluations=4000)}
    assert RareFailures.of(found).words == ["soft: P(not met) 1.25e-05, coefficient of variation 0.31, 4000 landings"]
    assert RareFailures.of(found).figure() is None


def ranking(interval=None, lost=None):
    rows = {
        "candidate": ["high", "low"],
        "spread_now": 0.2,
        "spread_expected": [0.05, 0.15],
        "shrinking": [0.75, 0.25],
        "sd left of mass": [0.9, 0.6],
    }
    return DropRanking(pd.DataFrame(rows), interval, lost or {})


def test_drops_are_shown_by_what_they_are_ranked_by():
    """By the spread: what shrinks. By an interval: what is not left of it."""
    assert ranking()._value == ({"high": 0.75, "low": 0.25}, "spread of P(met)")
    values, what = ranking("mass")._value
    assert values == pytest.approx({"high": 0.1, "low": 0.4}) and what == "sd of mass"
    assert [bar.get_width() for bar in ranking("mass").plot().patches] == pytest.approx([0.1, 0.4])


def test_drops_in_words():
    assert ranking("mass", {"far": "no wind"}).words == [
        "high: spread of P(met) 0.200 now, 0.050 expected after it, 90 % of the sd of mass left",
        "low: spread of P(met) 0.200 now, 0.150 expected after it, 60 % of the sd of mass left",
        "far: can't be judged: no wind",
    ]
    assert ranking().words[0] == "high: spread of P(met) 0.200 now, 0.050 expected after it"


def test_a_cell_of_the_placard_in_words():
    cell = SimpleNamespace(shear=6.0, capsule_mass=9000.0, word="no-go", pendulum=SimpleNamespace(met=0.256))
    assert Placard(pd.DataFrame(), (cell,)).words == ["shear 6 m/s, payload 9000 kg: no-go, pendulum 26 %"]
