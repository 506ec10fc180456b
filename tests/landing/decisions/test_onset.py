"""Placards: what makes a cell go or no-go, what is counted as a pendulum, and which landings a cell flies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.landing.decisions.onset import Cell, PlacardPlan, in_cell, placard, placard_table
from bayeschute.landing.decisions.requirements import Judgement, Limit, Requirement
from bayeschute.landing.measures import ROW
from bayeschute.landing.wind_plan import Event

CELLS = PlacardPlan((0.0, 4.0), (8000.0, 9000.0), 150.0, 60.0, 200, 0.2)
SOFT = Requirement("soft", (Limit("vertical_speed", 10.0),), 0.9, 0.9)


class _Said:
    def __init__(self, verdict):
        self.verdict = verdict


def _cell(*verdicts):
    return Cell(0.0, 1.0, None, tuple(Judgement(SOFT, None, _Said(one)) for one in verdicts))


@pytest.mark.parametrize(
    ("verdicts", "word"),
    [
        (("met", "met"), "go"),
        (("met", "not met"), "no-go"),
        (("can't tell yet", "not met"), "no-go"),
        (("met", "can't tell yet"), "can't tell"),
        ((), "can't tell"),
    ],
)
def test_one_requirement_that_is_not_met_is_enough(verdicts, word):
    assert _cell(*verdicts).word == word


def test_a_cell_adds_a_shear_over_the_ground_and_takes_the_mass_from_the_draws(plan):
    named = replace(plan.models[0], names=("capsule_mass", *plan.models[0].names[1:]))
    gust = Event("gust", 400.0, 0.0, 50.0, (1.0, 0.0, 0.0))
    given = replace(plan, models=(named,), winds=replace(plan.winds, events=(gust,)))
    made = in_cell(given, CELLS, 4.0, 8500.0)
    first, layer = made.winds.events
    assert first == gust and layer == Event("shear", plan.ground + 150.0, 0.0, 60.0, (4.0, 0.0, 0.0))
    (model,) = made.models
    assert model.base.capsule.mass == 8500.0 and model.names == ("", *plan.models[0].names[1:])
    np.testing.assert_array_equal(model.base.capsule.inertia, plan.models[0].base.capsule.inertia)
    assert made.seed == plan.seed and made.ground == plan.ground and model.theta is named.theta


def test_a_pendulum_is_a_swing_of_the_amplitude_or_more_of_landings_that_came_down(plan):
    told, said = [], []

    def flown(one, landings):
        told.append((one.winds.events[-1].change[0], one.models[0].base.capsule.mass, landings))
        rows = np.zeros(landings, ROW)
        rows["draw"] = np.arange(landings) % 10
        rows["swing_amplitude"] = np.where(np.arange(landings) < 50, 0.2, 0.19)
        rows["outcome"][:10], rows["swing_amplitude"][10:20] = 1, np.nan
        return rows

    made = placard(plan, CELLS, (SOFT,), flown, lambda share, words: said.append((share, words)))
    assert told == [(0.0, 8000.0, 200), (0.0, 9000.0, 200), (4.0, 8000.0, 200), (4.0, 9000.0, 200)]
    assert [share for share, _ in said] == [0.0, 0.25, 0.5, 0.75] and said[2][1] == "shear 4 m/s, payload 8000 kg"
    for one in made:
        assert one.pendulum.met == pytest.approx(30 / 200) and one.pendulum.failed == 10
    table = placard_table(made)
    assert table["capsule_mass_kg"].tolist() == [8000.0, 9000.0, 8000.0, 9000.0]
    (judged,) = made[0].judged
    assert table["soft: P(met)"][0] == judged.chance.met and table["soft: low"][0] == judged.chance.low
    assert table["soft: high"][0] == judged.chance.high and table["pendulum_high"][0] == made[0].pendulum.high
