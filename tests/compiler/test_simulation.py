"""The numbers of the Runge-Kutta stages, gone through by hand."""

from __future__ import annotations

import pytest

from bayeschute.compiler.simulation import STAGES, stage_plan


def gone(rate, x, h, substeps):
    """Through a sample as the machine code goes: begin, stage and sum; `rate` of state and share of the sample."""
    way, weight, place = stage_plan(h, substeps)
    for step in range(substeps):
        begin, stage, total = x, x, x
        for k in range(STAGES):
            slope = rate(stage, step / substeps + place[k])
            stage, total = begin + way[k] * slope, total + weight[k] * slope
        x = total
    return x


@pytest.mark.parametrize("substeps", [1, 3])
def test_a_linear_flight_grows_by_the_first_terms_of_the_exponential(substeps):
    h, z = 0.5, -0.7 * 0.5
    grown = 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0
    assert gone(lambda x, s: -0.7 * x, 2.0, h, substeps) == pytest.approx(2.0 * grown**substeps, rel=1e-14)


@pytest.mark.parametrize("substeps", [1, 3])
def test_what_depends_on_time_alone_is_integrated_as_by_simpson(substeps):
    """Cubics exactly: every stage is at its own share of the sample, which is `substeps` steps long."""
    h = 0.5
    made = gone(lambda x, s: 4.0 * s**3 - 6.0 * s**2 + 2.0 * s + 1.0, 0.0, h, substeps)
    assert made == pytest.approx(h * substeps * (1.0 - 2.0 + 1.0 + 1.0), rel=1e-14)
