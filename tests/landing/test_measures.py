"""Rows of landings: their numbers, and the other names that they go by on level ground."""

from __future__ import annotations

import numpy as np

from bayeschute.core.units import factor_to_si
from bayeschute.landing.measures import IDS, LABELS, MEASURES, ON_LEVEL_GROUND, OUTCOMES, ROW


def test_a_row_holds_ids_outcome_and_every_measure():
    assert ROW.names == (*IDS, "outcome", "label", "profile", *MEASURES)
    row = np.zeros(1, ROW)
    row["draw"], row["label"], row["profile"], row["time"] = 2**53 + 1, -1, 300, 1.0 / 3.0
    assert row["draw"][0] == 2**53 + 1 and row["label"][0] == -1 and row["profile"][0] == 300
    assert row["time"][0] == 1.0 / 3.0 and OUTCOMES[row["outcome"][0]] == "ok" and len(OUTCOMES) == 3
    assert len(set(LABELS)) == 6 and np.iinfo(ROW["label"]).max >= len(LABELS)


def test_units_are_si_and_those_on_level_ground_the_same():
    assert {factor_to_si(unit, unit)[0] for unit, _ in MEASURES.values()} == {1.0}
    assert {unit for unit, _ in MEASURES.values()} == {"s", "m", "m/s", "rad", "rad/s", "N"}
    for name, level in ON_LEVEL_GROUND.items():
        assert MEASURES[name][0] == MEASURES[level][0] and name != level
    for name, (unit, _) in MEASURES.items():
        ending = name.split("_")[-1]
        assert unit == {"speed": "m/s", "angle": "rad", "altitude": "m", "tension": "N", "shear": "m/s"}.get(
            ending, unit
        )
