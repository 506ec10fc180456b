"""Checks of ``[[knowledge]]`` against the rest of a study and its vehicle."""

from __future__ import annotations

from collections.abc import Iterator

from bayeschute.aero.coefficient import coefficient_names
from bayeschute.aero.published import load_published
from bayeschute.aero.published_curve import CURVES
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.record import nearest
from bayeschute.study.schema.belief_schema import PriorsTable
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.schema.schema_faults import show
from bayeschute.study.schema.structure_schema import StructureTable


def check_knowledge(draft: Draft) -> Iterator[Fault]:
    """Names are unique, targets are candidates of the study, and what is used as prior can be."""
    tables: tuple[KnowledgeTable, ...] = draft.tables.get("knowledge", ())
    if tables and draft.model == "descent":
        do = "Remove it; cds_over_mass has its prior in [priors.given]."
        wanted = "only what this model uses: a point mass has no curves"
        yield Fault(draft.at("knowledge", ""), "[[knowledge]] of the model 'descent'", wanted, do)
        return
    for i, table in enumerate(tables):
        if table.name in (other.name for other in tables[:i]):
            yield Fault(draft.at("knowledge", i, "name"), show(table.name), "a name used once only")
        yield from _check_target(draft, i, table)
        if table.published is not None:
            yield from _check_published(draft, i, table)
        if table.use == "prior":
            yield from _check_prior(draft, i, table)


def _check_target(draft: Draft, i: int, table: KnowledgeTable) -> Iterator[Fault]:
    structure: StructureTable | None = draft.tables.get("structure")
    where = draft.at("knowledge", i, "target")
    if table.kind == "coefficient" and structure is not None:
        known = coefficient_names(structure)
        if table.target not in known:
            do = nearest(table.target, known) or "Masses and risers have their priors in [priors.given]."
            yield Fault(where, show(table.target), "a coefficient of a candidate, such as 'axial[1]'", do)
    if table.target == "proximity" and draft.vehicle is not None and draft.vehicle.canopies.number < 2:
        yield Fault(where, "'proximity'", "a curve of a single canopy: the vehicle has no other")


def _check_published(draft: Draft, i: int, table: KnowledgeTable) -> Iterator[Fault]:
    where = draft.at("knowledge", i, "published")
    try:
        found = load_published(str(table.published))
    except InputError as error:
        for fault in error.faults:
            yield Fault(where, fault.got, fault.wanted, fault.do)
        return
    if found.form != "planar":
        wanted = "a planar set, such as 'table-7.1-2': curves of one angle"
        yield Fault(where, f"{table.published!r}, a {found.form} set", wanted)
    elif table.target not in CURVES:
        yield Fault(draft.at("knowledge", i, "target"), show(table.target), f"one of {', '.join(CURVES)}")


def _check_prior(draft: Draft, i: int, table: KnowledgeTable) -> Iterator[Fault]:
    structure: StructureTable | None = draft.tables.get("structure")
    priors: PriorsTable | None = draft.tables.get("priors")
    where = draft.at("knowledge", i, "use")
    if structure is not None and structure.stack is not None:
        wanted = "'compare' beside [structure] stack: priors of several structures come from equation error alone"
        yield Fault(where, "'prior'", wanted)
    if table.kind == "curve" and priors is not None and priors.hierarchical:
        wanted = "'compare' beside vary or vary_canopies: priors of populations have no correlations, a curve's do"
        yield Fault(where, "'prior'", wanted)
