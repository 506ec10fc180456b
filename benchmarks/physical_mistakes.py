"""Physical mistakes made on purpose on a flight: is each named, and is its right cause the first?

    python benchmarks/physical_mistakes.py STUDY.toml [--json]

The mistakes (axes, units, signs, angles, clocks, winds, masses, counts, sizes) were chosen for what people do, before
it was known which are found. A mistake counts as named where `bayeschute check` would refuse the flight, and as right
where the first cause that it tells is the one made.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from command import parser_of, print_result

if TYPE_CHECKING:
    import xarray as xr

    from bayeschute.records.plausibility.evidence import Nominal
    from bayeschute.records.plausibility.verdict import Verdict

FOOT, KNOT, POUND, SLUG, POUND_FORCE, G0 = 0.3048, 1852.0 / 3600.0, 0.45359237, 14.59390, 4.448222, 9.80665


@dataclass
class Case:
    """A flight that mistakes are made on.

    Attributes:
        record: As read, in SI.
        vehicle: What laws need of its vehicle.
        window: First and last time [s].
        profile: Wind by altitude; None: none.
    """

    record: xr.Dataset
    vehicle: Nominal
    window: tuple[float, float] | None = None
    profile: Callable[[Any], Any] | None = None

    def verdict(self) -> Verdict:
        """What the laws say of it."""
        from bayeschute.records.plausibility.evidence import evidence_of
        from bayeschute.records.plausibility.verdict import verdict

        return verdict(evidence_of(self.record, self.vehicle, self.window, self.profile))


class Made(NamedTuple):
    """A mistake.

    Attributes:
        name: In words.
        make: Makes it on a case, in place.
        cause: Pattern of the right cause's words.
    """

    name: str
    make: Callable[[Case], None]
    cause: str


def _times(factor: float, *names: str) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        for name in names:
            case.record[name].values *= factor

    return make


def _along(matrix: Any, *names: str) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        for name in names:
            case.record[name].values = case.record[name].values @ np.asarray(matrix, float).T

    return make


def _order(order: list[int], name: str) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        case.record[name].values = case.record[name].values[..., order]

    return make


def _wind(matrix: Any, factor: float = 1.0) -> Callable[[Case], None]:
    """On the recorded wind and on that by altitude, which come from one source."""

    def make(case: Case) -> None:
        turn, before = factor * np.asarray(matrix, float).T, case.profile
        case.record["wind"].values = case.record["wind"].values @ turn
        if before is not None:
            case.profile = lambda h: before(h) @ turn

    return make


def _vehicle(**changes: Any) -> Callable[[Case], None]:
    """Values that are numbers are factors; the number of canopies is told."""

    def make(case: Case) -> None:
        found = {k: x if k == "canopies" else getattr(case.vehicle, k) * x for k, x in changes.items()}
        case.vehicle = replace(case.vehicle, **found)

    return make


def _clock(factor: float) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        case.record = case.record.assign_coords(time=("time", factor * case.record["time"].values, {"units": "s"}))
        if case.window is not None:
            case.window = (factor * case.window[0], factor * case.window[1])

    return make


def _late(seconds: float, *names: str) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        step = float(np.median(np.diff(case.record["time"].values)))
        for name in names:
            case.record[name].values = np.roll(case.record[name].values, round(seconds / step), axis=0)

    return make


def _no_wind(case: Case) -> None:
    case.record, case.profile = case.record.drop_vars("wind"), None


def _without_gravity(case: Case) -> None:
    case.record["capsule_specific_force"].values += _gravity_b(case)


def _gravity_b(case: Case) -> Any:
    q = case.record["capsule_attitude"].values
    w, x, y, z = q.T
    down = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)], axis=1)
    return G0 * down


def _enu(case: Case) -> None:
    turn = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    _along(turn, "capsule_position", "capsule_velocity", "canopy_position")(case)
    _wind(turn)(case)


def _axis(axis: int, *names: str) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        for name in names:
            case.record[name].values[..., axis] *= -1.0

    return make


def _relative(case: Case) -> None:
    case.record["canopy_position"].values -= case.record["capsule_position"].values[:, None]


def _heading(degrees: float) -> Callable[[Case], None]:
    def make(case: Case) -> None:
        half = 0.5 * np.deg2rad(degrees)
        c, s = np.cos(half), np.sin(half)
        w, x, y, z = case.record["capsule_attitude"].values.T
        case.record["capsule_attitude"].values = np.stack(
            [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], 1
        )

    return make


def _density_of_feet(case: Case) -> None:
    from bayeschute.atmosphere.standard import standard_density

    height = -case.record["capsule_position"].values[:, 2]
    case.record["density"].values *= standard_density(height / FOOT) / standard_density(height)


def _altitude(case: Case, values: Any) -> None:
    case.record["altitude"] = ("time", values, {"units": "m"})


def _altitude_feet(case: Case) -> None:
    _altitude(case, -case.record["capsule_position"].values[:, 2] / FOOT)


def _swap_cells(case: Case) -> None:
    case.record["riser_tension"].values = case.record["riser_tension"].values[:, ::-1]


MADE = (
    Made("z points up (all positions and velocities)",
         _axis(2, "capsule_position", "capsule_velocity", "canopy_position"), r"z points up"),
    Made("z of the velocity points up", _axis(2, "capsule_velocity"), r"velocities: z points up"),
    Made("z of the canopies points up", _axis(2, "canopy_position"), r"canopy positions: z points up"),
    Made("capsule position in feet", _times(1 / FOOT, "capsule_position"), r"capsule positions are in feet, read"),
    Made("all positions in feet", _times(1 / FOOT, "capsule_position", "canopy_position"),
         r"^positions are in feet, read"),
    Made("velocity in feet per second", _times(1 / FOOT, "capsule_velocity"), r"velocities are in ft/s, read"),
    Made("velocity in knots", _times(1 / KNOT, "capsule_velocity"), r"velocities are in knots, read"),
    Made("altitude in feet", _altitude_feet, r"altitudes are in feet, read"),
    Made("rates in degrees per second", _times(180 / np.pi, "capsule_rate"), r"angular rates are in deg/s, read"),
    Made("quaternion scalar-last", _order([1, 2, 3, 0], "capsule_attitude"), r"quaternion is scalar-last, read"),
    Made("quaternion conjugated", _along(np.diag([1, -1, -1, -1]), "capsule_attitude"), r"quaternion is conjugated"),
    Made("a body axis of the gyros inverted", _axis(1, "capsule_rate"), r"axis y of the angular rate is inverted"),
    Made("a body axis of the accelerometers inverted", _axis(2, "capsule_specific_force"),
         r"axis z of the specific force is inverted"),
    Made("ENU read as NED", _enu, r"east, north, up, read as north, east, down"),
    Made("north and east swapped in the wind", _wind([[0, 1, 0], [1, 0, 0], [0, 0, 1]]), r"swapped in the wind$"),
    Made("wind 'from'", _wind(-np.eye(3)), r'wind is "from"'),
    Made("wind in knots", _wind(np.eye(3), 1 / KNOT), r"winds are in knots, read"),
    Made("wind in feet per second", _wind(np.eye(3), 1 / FOOT), r"winds are in ft/s, read"),
    Made("wind missing", _no_wind, r"wind is missing"),
    Made("mass in pounds", _vehicle(mass=1 / POUND), r"mass is in pounds, read"),
    Made("mass in grams", _vehicle(mass=1e3), r"mass is in grams, read"),
    Made("ten times the mass", _vehicle(mass=10.0), r"mass is ten times too great"),
    Made("a third of the payload omitted", _vehicle(mass=0.65), r"payload is missing"),
    Made("three canopies for two", _vehicle(canopies=3), r"number of canopies"),
    Made("one canopy for two", _vehicle(canopies=1), r"number of canopies"),
    Made("riser length in feet", _vehicle(riser_length=1 / FOOT), r"risers' length is in feet, read"),
    Made("riser length twice", _vehicle(riser_length=2.0), r"risers' length is twice"),
    Made("canopies 1 and 2 swapped against load cells", _swap_cells, r"order of the canopies"),
    Made("time in milliseconds", _clock(1000.0), r"times are in milliseconds"),
    Made("canopies 1.2 s late", _late(1.2, "canopy_position"), r"canopy positions are 1\.[123] s late"),
    Made("specific force in g", _times(1 / G0, "capsule_specific_force"), r"specific forces are in g, read"),
    Made("sign of the specific force", _times(-1.0, "capsule_specific_force"), r"specific force has the opposite sign"),
    Made("specific force without gravity", _without_gravity, r"specific force is without gravity"),
    Made("density in slug per cubic foot", _times(FOOT**3 / SLUG, "density"), r"densities are in slug/ft\^3, read"),
    Made("density of altitudes in feet", _density_of_feet, r"density was looked up at altitudes in feet"),
    Made("area in square feet", _vehicle(area=FOOT**-2), r"area is in square feet, read"),
    Made("load cells in pound-force", _times(1 / POUND_FORCE, "riser_tension"), r"load cells are in lbf, read"),
    Made("load cells in kilonewtons", _times(1e-3, "riser_tension"), r"load cells are in kN, read"),
    Made("canopies relative to the capsule", _relative, r"canopy positions are relative to the capsule$"),
    Made("heading off by 20 degrees", _heading(20.0), r"heading of the attitude is off by"),
    Made("attitude 0.8 s late", _late(0.8, "capsule_attitude"), r"the attitude is 0\.[789] s late"),
)  # fmt: skip


class Outcome(NamedTuple):
    """What was said of a mistake.

    Attributes:
        made: Which.
        named: Whether a fault was found.
        first: The first cause told.
        right: Whether that is the mistake made.
        place: Place of the right cause among those told, from 1; 0: not told.
        worst: The law that is off most.
    """

    made: Made
    named: bool
    first: str
    right: bool
    place: int
    worst: str


def judge(case: Case, made: Made) -> Outcome:
    """Make a mistake on a copy of a case, and see what is said."""
    spoilt = Case(case.record.copy(deep=True), case.vehicle, case.window, case.profile)
    made.make(spoilt)
    found = spoilt.verdict()
    faults = found.faults
    told = list(dict.fromkeys(cause for one in faults for cause in one.causes))
    told = [*found.causes[:1], *(cause for cause in told if cause not in found.causes[:1])]
    place = next((i for i, cause in enumerate(told, 1) if re.search(made.cause, cause)), 0)
    worst = max(faults, key=lambda one: one.excess).law if faults else ""
    return Outcome(made, bool(faults), told[0] if told else "", place == 1, place, worst)


def of_study(path: Path) -> Case:
    """The first flight of a study as a case."""
    from bayeschute.study.load import load_study
    from bayeschute.study.plausible import nominal, wind_by_altitude
    from bayeschute.study.run.stage_data import as_read

    study = load_study(path)
    flight = study.flights[0]
    assert flight.path is not None and study.vehicle is not None
    profile = None if flight.wind_profile is None else wind_by_altitude(flight.wind_profile)
    return Case(as_read(flight), nominal(study.vehicle, flight.capsule_mass), flight.window, profile)


def main() -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("study", type=Path)
    asked = parser.parse_args()
    case = of_study(asked.study)
    outcomes = [judge(case, made) for made in MADE]
    for one in outcomes:
        mark = "right" if one.right else (f"place {one.place}" if one.place else "not told")
        print(f"{one.made.name:46} {'fault' if one.named else 'SILENT':7} {mark:9} {one.worst:20} {one.first}")
    named, right = sum(o.named for o in outcomes), sum(o.right for o in outcomes)
    print(f"{len(outcomes)} mistakes: {named} named, right cause first in {right}")
    ratios = {
        "mistakes_named_share_larger": named / len(outcomes),
        "right_first_share_larger": right / len(outcomes),
    }
    print_result(asked, ratios, {"mistakes": len(outcomes), "named": named, "right": right})


if __name__ == "__main__":
    main()
