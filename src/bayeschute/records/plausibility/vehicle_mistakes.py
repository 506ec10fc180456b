"""Wrong numbers of the vehicle file: masses, sizes, counts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from bayeschute.core.units import factor_to_si
from bayeschute.records.plausibility.evidence import Evidence
from bayeschute.records.plausibility.mistake import Mistake, Undo, of_vehicle


def _factors(**factors: float) -> Undo:
    return of_vehicle(lambda vehicle: {k: x * getattr(vehicle, k) for k, x in factors.items()})


def vehicle_mistakes() -> Iterator[Mistake]:
    """Masses, sizes and counts of the vehicle file."""
    pound, foot = factor_to_si("lb", "kg")[0], factor_to_si("ft", "m")[0]
    slug = factor_to_si("slug", "kg")[0]
    for words, do, factor in (
        ("the capsule's mass is in pounds, read as kilograms", "Give it in 'lb'.", pound),
        ("the capsule's mass is in kilograms, read as pounds", "Give it in 'kg'.", 1.0 / pound),
        ("the capsule's mass is in slugs, read as kilograms", "Give it in 'slug'.", slug),
        ("the capsule's mass is in grams, read as kilograms", "Give it in 'g'.", 1e-3),
        ("the capsule's mass is in tonnes, read as kilograms", "Give it in 't'.", 1e3),
        ("the capsule's mass is ten times too great", "Check its digits.", 0.1),
        ("the capsule's mass is ten times too small", "Check its digits.", 10.0),
    ):
        yield Mistake(words, do, _factors(mass=factor), 0.12)
    for words, do, factor, doubt in (
        ("the risers' length is in feet, read as metres", "Give it in 'ft'.", foot, 0.1),
        ("the risers' length is in metres, read as feet", "Give it in 'm'.", 1.0 / foot, 0.1),
        (
            "the risers' length is twice what it should be",
            "Check it: is it there and back, or riser and lines counted twice?",
            0.5,
            0.15,
        ),
        ("the risers' length is half of what it should be", "Check it: are the suspension lines left out?", 2.0, 0.15),
    ):
        yield Mistake(words, do, _factors(riser_length=factor), doubt)
    for words, do, area, diameter, volume in (
        ("the canopies' area is in square feet, read as square metres", "Give it in 'ft^2'.", foot**2, 1.0, 1.0),
        ("the canopies' area is in square metres, read as square feet", "Give it in 'm^2'.", foot**-2, 1.0, 1.0),
        ("the canopies' diameter is in feet, read as metres", "Give it in 'ft'.", 1.0, foot, 1.0),
        ("the canopies' diameter is in metres, read as feet", "Give it in 'm'.", 1.0, 1.0 / foot, 1.0),
        ("the canopies' area and diameter are in feet, read as metres", "Give them in 'ft'.", foot**2, foot, 1.0),
        ("the canopies' diameter is a radius", "Give twice of it.", 1.0, 2.0, 1.0),
        ("the canopies' volume is in cubic feet, read as cubic metres", "Give it in 'ft^3'.", 1.0, 1.0, foot**3),
    ):  # fmt: skip
        yield Mistake(words, do, _factors(area=area, diameter=diameter, volume=volume))
    yield Mistake(
        "the canopies' area is that of all canopies together",
        "Give that of one canopy.",
        of_vehicle(lambda v: {"area": v.area / v.canopies} if v.canopies > 1 else None),
    )
    yield Mistake(
        "the attach point is on the wrong side of the centre of mass",
        "Mind that x of the structural frame points aft; or say points_in = 'body'.",
        _factors(attach_b=-1.0),
        0.15,
    )
    yield Mistake(
        "the capsule's inertia is in slug ft^2, read as kg m^2",
        "Give it in 'slug ft^2'.",
        _factors(inertia=slug * foot**2),
        0.2,
    )

    def counted(e: Evidence) -> Evidence | None:
        seen = e.canopies if e.canopies is not None else e.tension
        if e.vehicle is None or seen is None or seen.shape[1] == e.vehicle.canopies:
            return None
        return replace(e, vehicle=replace(e.vehicle, canopies=seen.shape[1]))

    yield Mistake(
        "the vehicle has another number of canopies than the record",
        "Set [canopies] number, or mend the columns.",
        counted,
    )
