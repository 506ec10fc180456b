"""Figures as files: panels and pictures have their size, feet their scale."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from bayeschute.report.figures import canvas


def test_dollar_signs_are_no_mathematics():
    assert canvas.literal("a $5 $x") == r"a \$5 \$x"


def test_panels_left_over_are_empty_and_every_row_has_its_height():
    figure, axes = canvas.panels(5, 3, 0.4, 2.0)
    assert len(axes) == 5 and [a.get_visible() for a in figure.axes] == [True] * 5 + [False]
    assert list(figure.get_size_inches()) == pytest.approx([canvas.WIDTH, 4.4])
    figure, axes = canvas.panels(2, 3, 0.4, 2.0, width=5.0)
    assert len(figure.axes) == 2 and list(figure.get_size_inches()) == pytest.approx([5.0, 2.4])


def test_the_second_axis_is_in_feet():
    axes = Figure().add_subplot()
    axes.set_ylim(0.0, 30.48)
    canvas.feet_axis(axes, "ft")
    axes.figure.draw_without_rendering()
    (second,) = axes.child_axes
    assert second.get_ylim() == pytest.approx((0.0, 100.0)) and second.get_ylabel() == "[ft]"


def test_a_clock_that_has_run_for_long_counts_from_near_the_first_sample():
    def shown(start):
        axes = Figure().add_subplot()
        axes.plot([start, start + 100.0], [0.0, 1.0])
        canvas.time_axis(axes, start)
        axes.figure.draw_without_rendering()
        return axes.get_xlabel(), [one.get_text() for one in axes.get_xticklabels()]

    for start in (0.0, -30.0):
        assert shown(start)[0] == "time [s]"
    label, ticks = shown(295_217.3)
    assert label == "time after 295200 s on the record's clock [s]" and {"20", "100"} <= set(ticks)


def test_a_figure_is_stored_twice_at_its_size_and_without_a_date(tmp_path):
    figure, (axes,) = canvas.sheet(1.0, width=2.0)
    axes.plot([0.0, 1.0], label="a")
    path = canvas.save(figure, tmp_path, "one")
    assert path.name == "one.svg" and sorted(p.name for p in tmp_path.iterdir()) == ["one.png", "one.svg"]
    width, height = (int.from_bytes((tmp_path / "one.png").read_bytes()[at : at + 4]) for at in (16, 20))
    assert (width, height) == (360, 180)
    text = path.read_text(encoding="utf-8")
    assert 'viewBox="0 0 144 72"' in text and "<dc:date>" not in text
