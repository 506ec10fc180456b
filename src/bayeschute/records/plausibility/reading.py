"""Result of a law for a record: its statistic relative to the limit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

NAMES = (  # of all laws
    "clock", "velocity.horizontal", "velocity.down", "canopy_velocity.horizontal", "canopy_velocity.down",
    "canopy_velocity.order", "falling.position", "falling.altitude", "falling.velocity", "falling.descent_rate",
    "altitude.rate", "altitude.datum", "altitude.descent_rate", "attitude.norm", "attitude.rate.x", "attitude.rate.y",
    "attitude.rate.z", "force.size", "force.horizontal", "force.turn", "force.down", "hanging.force",
    "hanging.attitude", "hanging.canopies", "count.canopies", "count.load_cells", "size.area", "size.volume",
    "size.inertia", "size.riser", "riser.length", "riser.scatter", "pull.direction", "pull.size", "pull.order",
    "balance.drag", "wind.present", "wind.profile", "wind.drift", "wind.share", "density.gas", "density.level",
    "density.slope", "pressure.altitude",
)  # fmt: skip
FAULT, WARNING = 1.0, 0.7  # excess from which a law is broken, and from which it is looked at


class Reading(NamedTuple):
    """A law, tried on a record.

    Attributes:
        law: Its name, by which a study accepts a breach.
        tests: What it compares, in words.
        excess: Statistic over its limit: 1 and more is a fault.
        got: The statistic, with its unit.
        wanted: The limit, in words.
    """

    law: str
    tests: str
    excess: float
    got: str
    wanted: str


def reading(law: str, tests: str, value: float, limit: float, form: str, wanted: str = "") -> list[Reading]:
    """A reading of a statistic that must stay below a limit; none where it isn't a number.

    Args:
        law: Name.
        tests: What is compared.
        value: Statistic, zero where the law is kept.
        limit: From which it is a fault.
        form: Of the statistic in words, such as ``"{:.2f} m/s apart"``.
        wanted: Empty: below the limit, in the same form.
    """
    if not np.isfinite(value):
        return []
    return [Reading(law, tests, abs(value) / limit, form.format(value), wanted or f"below {form.format(limit)}")]


def accepts(accepted: tuple[str, ...], law: str) -> bool:
    """Whether a law's breach is accepted: by its own name, or by that of its group (``wind`` of ``wind.drift``)."""
    return any(law == name or law.startswith(f"{name}.") for name in accepted)
