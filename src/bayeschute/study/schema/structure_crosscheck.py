"""Checks of `[structure]` and `[synthetic]` against the rest of a study and its vehicle."""

from __future__ import annotations

from collections.abc import Iterator

from bayeschute.aero.coefficient import coefficient_names
from bayeschute.aero.published import load_published
from bayeschute.aero.term_names import is_pairwise
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.record import nearest
from bayeschute.structure.polar_names import canonical
from bayeschute.study.schema.belief_schema import NoiseTable, PriorsTable
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.schema_faults import show
from bayeschute.study.schema.structure_schema import StructureTable, SyntheticTable

_OF_PROXIMITY = ("distance", "closing", "overlap", "proximity")


def check_polar(draft: Draft) -> Iterator[Fault]:
    """Variables of proximity need a second canopy."""
    structure: StructureTable | None = draft.tables.get("structure")
    if structure is None or draft.vehicle is None or draft.vehicle.canopies.number > 1:
        return
    for name, pool in structure.polar.pools().items():
        for item, variable in enumerate(pool.variables):
            if any(word in variable for word in _OF_PROXIMITY):
                where = draft.at("structure", "polar", name, "variables", item)
                yield Fault(where, show(variable), "variables of a single canopy: the vehicle has no other")


def check_terms(draft: Draft) -> Iterator[Fault]:
    """Terms of two canopies need a second one, and a search has one set of terms for all canopies and drops."""
    structure: StructureTable | None = draft.tables.get("structure")
    if structure is None:
        return
    priors: PriorsTable | None = draft.tables.get("priors")
    if structure.fit == "search" and priors is not None and priors.hierarchical:
        got = "'search' together with [priors] vary or vary_canopies"
        wanted = "'selected' or 'pool': what varies is a coefficient of terms that are in the model"
        yield Fault(draft.at("structure", "fit"), got, wanted, "Search without them first, then list the terms found.")
    fitted = [i for i, flight in draft.flights.items() if {"structure", "identify"} & set(flight.roles)]
    flown = [draft.vehicle_of(i) for i in fitted] or [draft.vehicle]
    if any(vehicle is None or vehicle.canopies.number > 1 for vehicle in flown):
        return
    for kind in ("axial", "transverse"):
        for item, term in enumerate(getattr(structure, kind)):
            if is_pairwise(term):
                wanted = "a term of a canopy alone: no flight that is fitted has a second one"
                yield Fault(draft.at("structure", kind, item), show(term), wanted)


def check_stack(draft: Draft) -> Iterator[Fault]:
    """Structures are weighted by a likelihood; the sandwich has none."""
    structure: StructureTable | None = draft.tables.get("structure")
    noise: NoiseTable | None = draft.tables.get("noise")
    if structure is not None and structure.stack is not None and noise is not None and noise.model == "sandwich":
        wanted = "another noise model: the sandwich has no predictive density to weight structures by"
        yield Fault(draft.at("structure", "stack"), "stack together with [noise] model = 'sandwich'", wanted)


def check_core(draft: Draft) -> Iterator[Fault]:
    """Terms that a search always keeps are candidates."""
    structure: StructureTable | None = draft.tables.get("structure")
    if structure is None or structure.fit != "search" or "core" not in structure.model_fields_set:
        return
    known = coefficient_names(structure)
    for i, name in enumerate(structure.core):
        if name not in known:
            yield Fault(
                draft.at("structure", "core", i), show(name), "a candidate, such as 'axial[1]'", nearest(name, known)
            )


def check_synthetic(draft: Draft) -> Iterator[Fault]:
    """The published terms are candidates, and the flight and canopy exist."""
    table: SyntheticTable | None = draft.tables.get("synthetic")
    if table is None:
        return
    if draft.model == "descent":
        do = "Remove it."
        yield Fault(draft.at("synthetic", ""), "a table that the model 'descent' has no use for", "no such table", do)
        return
    if draft.vehicle is not None and table.canopy > draft.vehicle.canopies.number:
        wanted = f"1 to {draft.vehicle.canopies.number}: the vehicle's number of canopies"
        yield Fault(draft.at("synthetic", "canopy"), f"canopy {table.canopy}", wanted)
    structural = [f.name for f in draft.flights.values() if "structure" in f.roles]
    if table.flight is not None and draft.flights_complete and table.flight not in structural:
        wanted = f"a flight with the role 'structure': one of {', '.join(structural)}"
        yield Fault(draft.at("synthetic", "flight"), show(table.flight), wanted)
    yield from _check_terms(draft, table)


def _check_terms(draft: Draft, table: SyntheticTable) -> Iterator[Fault]:
    try:
        published = load_published(table.published, table.reading)
    except InputError as error:
        for fault in error.faults:
            yield Fault(draft.at("synthetic", "reading"), fault.got, fault.wanted, fault.do)
        return
    if published.form != "polar":
        got = f"{table.published!r}, a {published.form} set"
        yield Fault(draft.at("synthetic", "published"), got, "a set of polar coefficients, such as 'table-7.3-1'")
        return
    structure: StructureTable | None = draft.tables.get("structure")
    if structure is None:
        return
    pools = structure.polar.pools()
    for name in table.snr.by_name():
        if name not in pools:
            where = draft.at("structure", "polar", name)
            yield Fault(where, "nothing", f"the pool of {name} that [synthetic] searches", "Add it.")
            continue
        known = pools[name].candidates()
        lacking = [term for term in published.of(name) if canonical(term) not in known]
        if lacking:
            where = draft.at("structure", "polar", name, "variables")
            yield Fault(
                where, f"no candidate {', '.join(lacking)}", f"a pool that holds all terms of {table.published}"
            )
