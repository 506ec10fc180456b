"""Tables for notebooks: no text is markup, and the ends of an interval are not swapped."""

from __future__ import annotations

import pandas as pd

from bayeschute.api import html

BAD = "<b>&\"'"


def test_no_text_is_markup():
    text = html.table(BAD, [BAD], [[BAD, 3]], BAD)
    assert text.count("&lt;b&gt;&amp;&quot;&#x27;") == 4 and "<b><b>" not in text and "<td>3</td>" in text
    assert "<p>" not in html.table("a", ["b"], [])


def test_a_summary_has_median_interval_and_unit_in_this_order():
    rows = pd.DataFrame({"low": [1.23456], "median": [2.0], "high": [3.5e-7], "unit": ["m/s"]}, index=["speed"])
    assert "<td>speed</td><td>2</td><td>1.235 to 3.5e-07</td><td>m/s</td>" in html.summary("t", "quantity", rows)
