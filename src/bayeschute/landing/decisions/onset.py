"""Onset of the pendulum: its probability by wind shear and payload, and a placard of go and no-go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.decisions.decision import Chance, chance
from bayeschute.landing.decisions.requirements import Judgement, Requirement, judge
from bayeschute.landing.wind_plan import Event

Fly = Callable[[CampaignPlan, int], NDArray[np.void]]
WORDS = {"met": "go", "not met": "no-go", "can't tell yet": "can't tell"}


@dataclass(frozen=True)
class PlacardPlan:
    """Cells of a placard.

    Attributes:
        shear: Changes of the wind across a layer (rows) [m/s].
        capsule_mass: Payloads (columns) [kg].
        middle: Altitude of the layer's middle over the ground [m].
        thickness: Of the layer [m].
        landings: Of every cell.
        amplitude: Of the swing before touchdown from which on it counts as a pendulum [rad].
    """

    shear: tuple[float, ...]
    capsule_mass: tuple[float, ...]
    middle: float
    thickness: float
    landings: int
    amplitude: float


class Cell(NamedTuple):
    """One wind and payload: P(pendulum), and the judgement of every requirement."""

    shear: float
    capsule_mass: float
    pendulum: Chance
    judged: tuple[Judgement, ...]

    @property
    def word(self) -> str:
        """``go`` where all requirements are met, ``no-go`` where one is not, else ``can't tell``."""
        found = {one.verdict.verdict for one in self.judged}
        return WORDS["not met" if "not met" in found else "met" if found == {"met"} else "can't tell yet"]


def in_cell(plan: CampaignPlan, cells: PlacardPlan, shear: float, mass: float) -> CampaignPlan:
    """The campaign with a layer of shear more, to the north unless the campaign turns its winds, and another payload.

    The payload changes the mass alone; the moments of inertia stay.
    """
    layer = Event("shear", plan.ground + cells.middle, 0.0, cells.thickness, (shear, 0.0, 0.0))
    models = tuple(
        replace(
            one,
            base=replace(one.base, capsule=replace(one.base.capsule, mass=mass)),
            names=tuple("" if name == "capsule_mass" else name for name in one.names),
        )
        for one in plan.models
    )
    return replace(plan, models=models, winds=replace(plan.winds, events=(*plan.winds.events, layer)))


def placard(
    plan: CampaignPlan,
    cells: PlacardPlan,
    wanted: Sequence[Requirement],
    fly: Fly,
    progress: Callable[[float, str], None] | None = None,
) -> list[Cell]:
    """Fly all cells, the same draws, winds and starts in each.

    Args:
        plan: The campaign.
        cells: Winds and payloads.
        wanted: Requirements by which a day is judged.
        fly: Flies so many landings of a plan.
        progress: Called with the share done and words.
    """
    made = []
    todo = [(shear, mass) for shear in cells.shear for mass in cells.capsule_mass]
    for i, (shear, mass) in enumerate(todo):
        if progress is not None:
            progress(i / len(todo), f"shear {shear:.3g} m/s, payload {mass:.5g} kg")
        rows = fly(in_cell(plan, cells, shear, mass), cells.landings)
        fine = rows["outcome"] == 0
        swings = fine & (np.nan_to_num(rows["swing_amplitude"]) >= cells.amplitude)
        pendulum = chance(rows["draw"], swings, int((~fine).sum()))
        made.append(Cell(shear, mass, pendulum, tuple(judge(one, rows) for one in wanted)))
    return made


def placard_table(cells: Sequence[Cell]) -> pd.DataFrame:
    """A row for each cell: verdict, P(pendulum) and P(met) of each requirement with their intervals."""
    rows = []
    for one in cells:
        row = {"shear_m_per_s": one.shear, "capsule_mass_kg": one.capsule_mass, "verdict": one.word}
        row |= {
            "pendulum_probability": one.pendulum.met,
            "pendulum_low": one.pendulum.low,
            "pendulum_high": one.pendulum.high,
        }
        for judged in one.judged:
            name, found = judged.requirement.name, judged.chance
            row |= {f"{name}: P(met)": found.met, f"{name}: low": found.low, f"{name}: high": found.high}
        rows.append(row)
    return pd.DataFrame(rows)
