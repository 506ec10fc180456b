"""Checks across the tables of a study and its vehicle; each uses the tables that are valid."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

from bayeschute.core.errors import Fault
from bayeschute.study.schema.belief_schema import FORCES, GivenTable, NoiseTable, PriorsTable
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.knowledge.knowledge_crosscheck import check_knowledge
from bayeschute.study.schema.reading.strict import UnknownValueError
from bayeschute.study.schema.schema_faults import show
from bayeschute.study.schema.structure_crosscheck import (
    check_core,
    check_polar,
    check_stack,
    check_synthetic,
    check_terms,
)
from bayeschute.study.schema.study_schema import QUANTITIES, PredictTable, RequirementTable, predictable
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN

_CLUSTER_PRIORS = ("riser_stiffness", "riser_damping", "riser_length")
_OF_DESCENT = "cds_over_mass"
_OF_CHANNELS = {  # the channel by which a parameter of its instrument is found
    "canopy_position_scale": "canopy_position",
    "canopy_position_bias": "canopy_position",
    "capsule_attitude_bias": "capsule_attitude",
}
OF_NO_TABLE = ("capsule_axial_force", "capsule_normal_force_slope", "capsule_pitch_moment_slope")
"""Parameters that a capsule with a table of coefficients has not."""
_CLUSTER_ONLY = (
    "canopy_position", "capsule_velocity", "capsule_attitude", "swing_angle", "riser_tension", "canopy_velocity"
)  # fmt: skip
_CLUSTER_CHANNELS = (*_CLUSTER_ONLY, "descent_rate")


def check_names(draft: Draft) -> Iterator[Fault]:
    """Names are unique: of flights ignoring case (they become file names), of requirements as written."""
    taken: set[str] = set()
    for index, flight in draft.flights.items():
        if flight.name.casefold() in taken:
            yield Fault(draft.at("flight", index, "name"), show(flight.name), "a name used once only")
        taken.add(flight.name.casefold())
    requirements: tuple[RequirementTable, ...] = draft.tables.get("requirement", ())
    for index, requirement in enumerate(requirements):
        if requirement.name in (other.name for other in requirements[:index]):
            yield Fault(draft.at("requirement", index, "name"), show(requirement.name), "a name used once only")


def check_roles(draft: Draft) -> Iterator[Fault]:
    """Something is identified, and in the cluster model some flight gives the structure."""
    needed = {"identify": "fitted"} | ({"structure": "searched for its structure"} if draft.model == "cluster" else {})
    if draft.flights_complete:
        for role, use in needed.items():
            if not any(role in flight.roles for flight in draft.flights.values()):
                do = f"Add roles = [{role!r}] to the flight that is to be {use}.".replace("'", '"')
                yield Fault(draft.at("flight", ""), f"no flight with the role {role!r}", "one at least", do)


def check_model_cluster(draft: Draft) -> Iterator[Fault]:
    """Tables that the cluster model needs, and those that it does not use."""
    if "vehicle" not in draft.raw:
        yield Fault(draft.at("vehicle"), "nothing", "the path of a vehicle file (model 'cluster')")
    if "structure" not in draft.raw:
        yield Fault(draft.at("structure", ""), "no such table", "a table [structure] (model 'cluster')")
    noise: NoiseTable | None = draft.tables.get("noise")
    yield from _check_wind(draft, noise)
    if noise is not None:
        if not any(getattr(noise, name) for name in _CLUSTER_CHANNELS):
            yield Fault(draft.at("noise", ""), "no channel", f"one at least of {', '.join(_CLUSTER_CHANNELS)}")
        for name, wind in (("wind", noise.wind), ("slow_wind", noise.slow_wind)):
            if wind is not None and wind.horizontal is None:
                yield Fault(draft.at("noise", name, "horizontal"), "nothing", "a speed (model 'cluster')", "Add it.")
    unseen = [name for name, c in _OF_CHANNELS.items() if noise is not None and getattr(noise, c) is None]
    yield from _check_given(draft, needed=_CLUSTER_PRIORS, useless=(_OF_DESCENT, *unseen))
    yield from _check_capsule(draft)
    yield from _check_mass(draft)
    yield from _check_vary(draft)
    for index, flight in draft.flights.items():
        for key in ("skip_first", "identify_until"):
            if key in flight.model_fields_set:
                yield _no_use(draft, "flight", index, key)


def check_model_descent(draft: Draft) -> Iterator[Fault]:
    """Tables that the descent model needs, and those that it does not use."""
    for key in ("vehicle", "structure"):
        if key in draft.raw:
            yield _no_use(draft, key)
    noise: NoiseTable | None = draft.tables.get("noise")
    yield from _check_wind(draft, noise)
    if noise is not None:
        if noise.descent_rate is None:
            yield Fault(draft.at("noise", "descent_rate"), "nothing", "a table of noise (model 'descent')", "Add it.")
        for name, wind in (("wind", noise.wind), ("slow_wind", noise.slow_wind)):
            if wind is not None and wind.horizontal is not None:
                yield _no_use(draft, "noise", name, "horizontal")
        for name in (*_CLUSTER_ONLY, *FORCES):
            if getattr(noise, name) is not None:
                yield _no_use(draft, "noise", name)
    priors: PriorsTable | None = draft.tables.get("priors")
    for key in ("inflation", "floor", "vary", "vary_canopies", "spread"):
        if priors is not None and key in priors.model_fields_set:
            yield _no_use(draft, "priors", key)
    others = tuple(name for name in GivenTable.model_fields if name != _OF_DESCENT)
    yield from _check_given(draft, needed=(_OF_DESCENT,), useless=others)
    for index, flight in draft.flights.items():
        if flight.vehicle is not None:
            yield _no_use(draft, "flight", index, "vehicle")
        if flight.virtual is not None:
            yield Fault(draft.at("flight", index, "virtual"), "a virtual drop", "a file (model 'descent')")
        if flight.remove_velocity_bias:
            yield _no_use(draft, "flight", index, "remove_velocity_bias")
        for key in ("capsule_mass", "wind_profile"):
            if getattr(flight, key) is not None:
                yield _no_use(draft, "flight", index, key)
        if "structure" in flight.roles:
            yield _no_use(draft, "flight", index, "roles", got="the role 'structure'")


def _check_wind(draft: Draft, noise: NoiseTable | None) -> Iterator[Fault]:
    """A fit with latent disturbances has one of the wind."""
    if noise is not None and noise.model == "latent" and noise.wind is None:
        yield Fault(draft.at("noise", "wind"), "nothing", "a table: the latent wind error of noise model 'latent'")


def _check_capsule(draft: Draft) -> Iterator[Fault]:
    """Where a table has the capsule's coefficients, none of the numbers in whose place it stands is fitted."""
    priors: PriorsTable | None = draft.tables.get("priors")
    if priors is None or draft.vehicle is None or draft.vehicle.capsule.table is None:
        return
    for name in OF_NO_TABLE:
        if getattr(priors.given, name) is not None:
            got = "a prior of what the vehicle's [capsule.table] tells"
            yield Fault(draft.at("priors", "given", name), got, "none", "Remove it, or the table.")


def _check_mass(draft: Draft) -> Iterator[Fault]:
    """A fitted flight has one mass: the vehicle's, to which the prior belongs, or its own."""
    priors: PriorsTable | None = draft.tables.get("priors")
    if priors is not None and priors.given.capsule_mass is not None:
        for index, flight in draft.flights.items():
            for key in ("capsule_mass", "vehicle"):
                if getattr(flight, key) is not None and "identify" in flight.roles:
                    where, got = draft.at("flight", index, key), f"{key} of a fitted flight's own"
                    wanted = "none together with [priors.given] capsule_mass, which is fitted"
                    yield Fault(where, got, wanted, "Remove one of them.")


def _check_vary(draft: Draft) -> Iterator[Fault]:
    """Drops or canopies differ about a population where there are several; then one structure is fitted to all."""
    priors: PriorsTable | None = draft.tables.get("priors")
    if priors is None:
        return
    fitted = sum("identify" in flight.roles for flight in draft.flights.values())
    if priors.vary is not None and draft.flights_complete and fitted < 2:
        wanted = "two flights at least with the role 'identify': a population is of several drops"
        yield Fault(draft.at("priors", "vary"), f"{fitted} of them", wanted, "Add flights, or remove the key.")
    number = 2 if draft.vehicle is None else draft.vehicle.canopies.number
    if priors.vary_canopies is not None and draft.flights_complete and fitted * number < 2:
        wanted = "two at least in the flights with the role 'identify': a population is of several canopies"
        yield Fault(draft.at("priors", "vary_canopies"), f"{fitted * number} canopies", wanted, "Remove the key.")
    for name in priors.vary_canopies or ():
        if name in (priors.vary or ()):
            wanted = "each in one of the two: what differs from canopy to canopy differs from drop to drop"
            yield Fault(draft.at("priors", "vary_canopies"), f"{name}, which vary names too", wanted)
    varying = (*(priors.vary or ()), *(priors.vary_canopies or ()))
    for name in priors.spread or ():
        if name not in varying:
            where, wanted = draft.at("priors", "spread", name), "a parameter that vary or vary_canopies names"
            yield Fault(where, show(name), wanted, "Name it there, or remove it here.")
    structure = draft.tables.get("structure")
    for key in ("vary", "vary_canopies"):
        if getattr(priors, key) is not None and structure is not None and structure.stack is not None:
            wanted = "one of the two: populations are of one structure"
            yield Fault(
                draft.at("priors", key), f"{key} together with [structure] stack", wanted, "Remove one of them."
            )


def _no_use(draft: Draft, *loc: int | str, got: str = "") -> Fault:
    """Fault of a key that would be ignored."""
    got = got or f"{loc[-1]!r}, which the model {draft.model!r} has no use for"
    return Fault(draft.at(*loc), got, "only what this model uses", "Remove it.")


def _check_given(draft: Draft, needed: tuple[str, ...], useless: tuple[str, ...]) -> Iterator[Fault]:
    """Priors from outside that the model needs, and those it has no use for."""
    priors: PriorsTable | None = draft.tables.get("priors")
    if priors is None:
        return
    for name in needed:
        if getattr(priors.given, name) is None:
            wanted = f"mean and sd, or median and log_sd (model {draft.model!r})"
            yield Fault(draft.at("priors", "given", name), "nothing", wanted, "Add it.")
    for name in useless:
        if getattr(priors.given, name) is not None:
            yield _no_use(draft, "priors", "given", name)


def check_canopies(draft: Draft) -> Iterator[Fault]:
    """Canopies named in the study exist in the vehicle, and are named where there are several to choose from."""
    structure = draft.tables.get("structure")
    if structure is not None and draft.vehicle is not None:
        number = draft.vehicle.canopies.number
        if number > 1 and "canopies" not in structure.model_fields_set:
            wanted = f"on which of the vehicle's {number} canopies the structure is found; the others test it"
            yield Fault(draft.at("structure", "canopies"), "nothing", wanted, "Say canopies = [1], or the best seen.")
        for index, canopy in enumerate(structure.canopies):
            if canopy > number:
                where = draft.at("structure", "canopies", index)
                yield Fault(where, f"canopy {canopy}", f"1 to {number}: the vehicle's number of canopies")


def check_vehicles(draft: Draft) -> Iterator[Fault]:
    """Flights of a file have as many canopies as its vehicle; virtual drops have aerodynamics to fly with."""
    for index, flight in draft.flights.items():
        vehicle = draft.vehicle_of(index)
        if vehicle is None:
            continue
        if draft.vehicle is not None and vehicle.canopies.number != draft.vehicle.canopies.number:
            where, got = draft.at("flight", index, "vehicle"), f"{vehicle.canopies.number} canopies"
            do = "Predict it from the finished run by a file of its own, that vehicle at its top: bayeschute predict."
            yield Fault(where, got, f"{draft.vehicle.canopies.number}, as many as the vehicle at the file's top", do)
        if flight.virtual is not None and vehicle.aero == NOT_FLOWN:
            where, wanted = draft.at("flight", index, "virtual"), "one with [aero], with which virtual drops fly"
            yield Fault(where, f"the vehicle {vehicle.name!r} without [aero]", wanted, "Add the table to its file.")


def check_shape(draft: Draft) -> Iterator[Fault]:
    """A virtual drop gives the shape of each canopy where the vehicle's canopies breathe."""
    if draft.vehicle is None:
        return
    number, breathes = draft.vehicle.canopies.number, draft.vehicle.canopies.breathing is not None
    for index, flight in draft.flights.items():
        shape = () if flight.virtual is None else flight.virtual.shape
        if shape and not (breathes and len(shape) == number):
            wanted = (
                f"{number} numbers, one for each canopy" if breathes else "none: the vehicle's canopies don't breathe"
            )
            yield Fault(draft.at("flight", index, "virtual", "shape"), f"{len(shape)} numbers", wanted)


def check_canopy_sd(draft: Draft) -> Iterator[Fault]:
    """Coefficients by which canopies of virtual drops differ are among those that the vehicle flies with."""
    if draft.vehicle is None:
        return
    known = draft.vehicle.aero.coefficients()
    for index, flight in draft.flights.items():
        for name in () if flight.virtual is None else flight.virtual.canopy_sd or ():
            if name not in known:
                where = draft.at("flight", index, "virtual", "canopy_sd", name)
                yield Fault(where, show(name), f"one of {', '.join(known)}: what the vehicle flies with")


def check_times(draft: Draft) -> Iterator[Fault]:
    """Windows lie within virtual drops; cuts lie within windows."""
    for index, flight in draft.flights.items():
        drop, window = flight.virtual, flight.window
        if drop is not None and window is not None and not 0.0 <= window[0] < window[1] <= drop.duration:
            got = "{:g} s to {:g} s".format(*window)
            yield Fault(draft.at("flight", index, "window"), got, f"times within the drop of {drop.duration:g} s")
        elif window is not None:
            yield from check_span(draft, index, *window)
        elif drop is not None:
            yield from check_span(draft, index, 0.0, drop.duration)


def check_span(draft: Draft, index: int, start: float, end: float) -> Iterator[Fault]:
    """Cuts of a flight lie within the times that are used.

    Args:
        draft: The study as far as its tables could be read.
        index: The flight's place in the file.
        start: First time used [s].
        end: Last time used [s].
    """
    flight = draft.flights[index]
    if flight.skip_first >= end - start:
        wanted = f"less than the {end - start:g} s of the flight"
        yield Fault(draft.at("flight", index, "skip_first"), f"{flight.skip_first:g} s", wanted)
    elif flight.identify_until and not start + flight.skip_first < flight.identify_until.at(start, end) < end:
        wanted = f"a time between {start + flight.skip_first:g} s and {end:g} s: after skip_first, before the end"
        got = f"{flight.identify_until.at(start, end):g} s"
        yield Fault(draft.at("flight", index, "identify_until"), got, wanted)


def check_predictions(draft: Draft) -> Iterator[Fault]:
    """The model has the quantities to predict, and requirements refer to predicted ones."""
    if draft.model is None:
        return
    known = QUANTITIES[draft.model]
    predict: PredictTable = draft.tables.get("predict", PredictTable())
    for index, name in enumerate(predict.quantities or ()):
        if name not in known:
            where = draft.at("predict", "quantities", index)
            yield Fault(where, show(name), f"one of {', '.join(known)} (model {draft.model!r})")
    predicted = predictable(draft.model, draft.vehicle, predict.quantities)
    for index, requirement in enumerate(draft.tables.get("requirement", ())):
        if requirement.quantity not in predicted:
            wanted = f"a quantity that is predicted: one of {', '.join(predicted)}"
            yield Fault(draft.at("requirement", index, "quantity"), show(requirement.quantity), wanted)


def crosscheck(draft: Draft) -> list[Fault]:
    """Every fault across the tables of a study and its vehicle."""
    by_model = {"cluster": check_model_cluster, "descent": check_model_descent}
    checks: list[Callable[[Draft], Iterator[Fault]]] = [check_names, check_roles]
    if draft.model is not None:
        checks.append(by_model[draft.model])
    checks += [check_canopies, check_vehicles, check_shape, check_canopy_sd, check_polar, check_core, check_stack]
    checks += [check_terms, check_synthetic, check_times, check_predictions, check_knowledge]
    return [fault for check in checks for fault in as_far_as_known(check(draft))]


def as_far_as_known(faults: Iterator[Fault]) -> Iterator[Fault]:
    """Faults of a check as far as it can be made: it ends where it asks for a value that could not be read."""
    with suppress(UnknownValueError):
        yield from faults
