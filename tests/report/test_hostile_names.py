"""Names and titles that other programs would take for commands: they are shown as they are written."""

from __future__ import annotations

import pandas as pd
import pytest

from bayeschute.report.figures.canvas import literal, save
from bayeschute.report.figures.landing_figures import drivers_figure
from bayeschute.report.record_page import write_record_page

TITLE = "<script>alert(1)</script> {0} {{ 7 * 7 }} [red] \"'&"


def test_no_title_and_no_fault_is_markup_in_the_page_of_records(tmp_path):
    text = write_record_page(tmp_path / "r.html", TITLE, {}, [f"column {TITLE}"]).read_text(encoding="utf-8")
    assert "<script" not in text and text.count("&lt;script&gt;alert(1)&lt;/script&gt; {0} {{ 7 * 7 }} [red] ") == 3


@pytest.mark.parametrize("name", ["costs $5 or $x_", "$\\frac{$", "a_$b$", "one $"])
def test_a_requirement_with_dollar_signs_is_drawn_as_text(tmp_path, name):
    """Matplotlib took them for mathematics: a landing ended in its traceback when its shares were drawn."""
    rows = [(name, kind, "winds", 0.5, 0.1) for kind in ("total", "shapley")]
    table = pd.DataFrame(rows, columns=["quantity", "kind", "source", "share", "standard_error"])
    figure = drivers_figure(table)
    save(figure, tmp_path, "shares")
    assert figure.axes[0].get_title(loc="left").startswith(literal(name).replace("_", " "))
