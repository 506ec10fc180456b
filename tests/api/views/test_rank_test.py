"""The table and the verdict of a rank test."""

from __future__ import annotations

from bayeschute.api.views.rank_test import RankTest

ONE = {"value": 0.02, "bound": 0.001, "passed": True, "mean_rank": 0.51}


def test_the_verdict_is_of_all_quantities_and_the_rows_of_each():
    found = {"replicates": 100, "passed": False, "quantities": {"axial[1]": ONE, "q": ONE | {"value": 1e-4}}}
    test = RankTest(found)
    assert test.passed is False and repr(test).startswith("Ranks over 100 replicates are not uniform\n")
    assert test.table.loc["q", "value"] == 1e-4 and test.table.loc["axial[1]", "mean_rank"] == 0.51
    html = test._repr_html_()
    assert "<td>axial[1]</td><td>0.0200</td><td>0.0010</td>" in html and "are not uniform</b>" in html
    assert "are uniform" in repr(RankTest(found | {"passed": True}))
