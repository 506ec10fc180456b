"""Levels: the worst of what applies, contradictions first, and a label that cannot be read as more than it says."""

from __future__ import annotations

import pytest

from bayeschute.calibration.label import CONTRADICTED, Level, Rung, claim, has_level

SELF = Rung(Level.SELF_CONSISTENT, (), "120 replicates, coverage 87 to 94 %")
OTHERS = Rung(Level.OTHER_PROGRAMS, ("held-out parts of 0 flights",), applies=False)
RECORDED = Rung(Level.RECORDED, (), "25 flights, 90 ± 2 %")
NONE = Rung(Level.RECORDED, ("held-out parts of 0 records",), applies=False)


def test_replicates_alone_are_self_consistent():
    made = claim([SELF, OTHERS, NONE], misspecification="74 % with a wrong wind profile")
    assert made.level is Level.SELF_CONSISTENT
    assert made.label == (
        "self-consistent: 120 replicates, coverage 87 to 94 %; worst case stored of a wrong model: "
        "74 % with a wrong wind profile"
    )
    assert has_level(made.label) and "nothing of errors of mass" in made.sentences[0]


def test_without_a_stored_misspecification_the_label_says_so():
    assert claim([SELF]).label.endswith("; no case of a wrong model is stored")


def test_a_rung_that_applies_and_fails_ends_the_climb():
    made = claim([Rung(Level.SELF_CONSISTENT, ("duration 30 s, replicates had 90 s",)), RECORDED])
    assert made.level is Level.NOT_CHECKED and not has_level(made.label)
    assert made.label == "not checked: duration 30 s, replicates had 90 s"


def test_a_rung_that_does_not_apply_is_stepped_over():
    descent = Rung(Level.SELF_CONSISTENT, ("calibration is not available",), applies=False)
    assert claim([descent, OTHERS, RECORDED]).level is Level.RECORDED
    assert claim([SELF, OTHERS, RECORDED]).evidence == "25 flights, 90 ± 2 %"


def test_a_contradicted_run_has_no_level_and_says_so_first():
    made = claim([SELF, RECORDED], contradicted=["the 90 % band contains only 35 % of it"])
    assert made.level is Level.NOT_CHECKED and made.evidence == ""
    assert made.label.startswith(f"{CONTRADICTED}, no level: the 90 % band contains only 35 % of it")
    assert not has_level(made.label)


def test_without_any_evidence_nothing_is_claimed():
    made = claim([Rung(Level.SELF_CONSISTENT, ("none is stored",), applies=False)])
    assert made.level is Level.NOT_CHECKED and made.label == "not checked: none is stored"
    assert claim([]).label == "not checked: no evidence is stored"


@pytest.mark.parametrize("label", ["", "verified: 120 replicates", "self-consistently made", "no fit"])
def test_other_words_are_no_level(label):
    assert not has_level(label)


def test_what_is_not_promised_is_named():
    made = claim([SELF], not_promised=["landings", "riser_length (100 ± 1 %, too wide)"])
    assert "Not promised by any calibration: landings, riser_length (100 ± 1 %, too wide)." in made.sentences
    assert "Nothing is promised: neither" in claim([], not_promised=["landings"]).sentences[1]
    assert made.plain()["level"] == "self-consistent" and made.plain()["rank"] == 1


def test_a_claim_prints_its_label_and_what_to_know_beside_it():
    sound, lost = claim([SELF]), claim([SELF], contradicted=["the record"])
    assert str(sound).splitlines() == [sound.label, *sound.sentences] and repr(sound) == f"Claim({sound.label!r})"
    assert (sound.words, lost.words, claim([]).words) == ("self-consistent", CONTRADICTED, "not checked")


def test_what_to_do_is_said_where_a_run_contradicts_itself_and_only_there():
    held = [Rung(Level.SELF_CONSISTENT, kept="40 replicates")]
    told = claim(held, contradicted=["the record is not one that the model makes"]).sentences
    assert "what to try" in told[1] and "no probabilities" in told[1]
    assert not any("what to try" in one for one in claim(held).sentences)
