"""What others know against the rest of a study: names, targets, published sets, and what can be a prior."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.study.schema.knowledge.written import COEFFICIENT, CURVE, with_text

from bayeschute.study.load import check_study
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.knowledge.knowledge_crosscheck import check_knowledge


def _published(target: str, name: str = "table-7.1-2") -> str:
    return CURVE.replace("C_N", target).split("points")[0] + f'published = "{name}"\n'


def test_published_sets_are_known_by_name(cluster: Path):
    assert check_study(with_text(cluster, _published("C_N_rate"))) == []


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (_published("C_N", "table-7.3-1"), "a planar set"),
        (_published("C_N", "table-9"), "one of table-7.1-2"),
        (_published("proximity"), "one of C_A, C_N, C_N_rate"),
        (_published("C_N") + "sd = 0.1\n", "no sd"),
        (COEFFICIENT + COEFFICIENT, "a name used once only"),
    ],
)
def test_published_sets_that_do_not_fit_and_names_used_twice(cluster: Path, text, wanted):
    faults = check_study(with_text(cluster, text))
    assert any(wanted in f.wanted for f in faults), list(map(str, faults))


def test_what_can_not_be_a_prior_is_told(cluster: Path, spoil):
    study = with_text(cluster, CURVE.replace('kind = "curve"', 'kind = "curve"\nuse = "prior"'))
    spoil(study, r"^\[priors\]", '[priors]\nvary_canopies = ["axial[1]"]')
    spoil(study, r'^fit = "search"', 'fit = "pool"')
    (fault,) = check_study(study)
    assert "use" in fault.where and "beside vary or vary_canopies" in fault.wanted


def test_a_point_mass_has_no_use_for_it(descent: Path):
    faults = check_study(with_text(descent, COEFFICIENT))
    assert any("point mass" in f.wanted for f in faults)


def known(name="k", kind="coefficient", target="axial[1]", use="compare", published=None):
    return SimpleNamespace(name=name, kind=kind, target=target, use=use, published=published)


def told(*tables, model="cluster", canopies=2, stack=None, hierarchical=False):
    vehicle = SimpleNamespace(canopies=SimpleNamespace(number=canopies))
    own = {
        "model": model,
        "knowledge": tables,
        "structure": SimpleNamespace(axial=("1", "alpha^2"), transverse=("e",), stack=stack),
        "priors": SimpleNamespace(hierarchical=hierarchical),
    }
    draft = Draft("x.toml", {"knowledge": [{"name": one.name} for one in tables]}, own, {}, vehicle)
    return [f"{fault.where}: {fault.got}; {fault.wanted} {fault.do}" for fault in check_knowledge(draft)]


def test_sound_tables_have_no_fault():
    some = known(), known("b", "curve", "C_A"), known("c", "curve", "proximity"), known("d", use="prior")
    assert told(*some) == [] and told() == [] and told(model="descent") == []


def test_a_point_mass_is_told_once_whatever_else_is_wrong():
    (fault,) = told(known(target="q"), known(), model="descent")
    assert "[[knowledge]] of the model 'descent'" in fault


def test_the_second_of_a_name_is_at_fault():
    (fault,) = told(known("a"), known("b"), known("a"))
    assert "(knowledge 'a')" in fault and "once only" in fault


def test_a_coefficient_is_one_of_a_candidate():
    (near,) = told(known(target="axial[alpha^3]"))
    assert "a coefficient of a candidate" in near and "axial[alpha^2]" in near
    (far,) = told(known(target="mass"))
    assert "[priors.given]" in far
    assert told(known(kind="curve", target="mass")) == []  # the schema judges curves


def test_a_single_canopy_has_no_neighbour():
    (fault,) = told(known(kind="curve", target="proximity"), canopies=1)
    assert "'proximity'" in fault and "the vehicle has no other" in fault
    assert told(known(kind="curve", target="C_A"), canopies=1) == []


def test_a_stack_of_structures_takes_no_prior_and_populations_none_of_curves():
    assert told(known(), known("b", "curve", "C_A"), stack=3, hierarchical=True) == []
    (fault,) = told(known(use="prior"), stack=3)
    assert "stack" in fault and "use" in fault
    (fault,) = told(known(kind="curve", target="C_A", use="prior"), hierarchical=True)
    assert "vary or vary_canopies" in fault
    assert told(known(use="prior"), hierarchical=True) == []


def test_tables_that_could_not_be_read_are_not_judged_by():
    draft = Draft("x.toml", {}, {"knowledge": (known(target="q", use="prior"),)}, {}, None)
    assert list(check_knowledge(draft)) == []
