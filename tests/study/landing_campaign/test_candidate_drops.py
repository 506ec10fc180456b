"""Candidate drops: how each would be recorded, and what their files may not say."""

from __future__ import annotations

import pytest
from tests.landing.plans import ROOT

from bayeschute.core.errors import InputError
from bayeschute.study.landing_campaign.candidate_drops import candidates
from bayeschute.study.load import load_study

STUDY = load_study(ROOT / "models/studies/cdt-3-11.toml")
SHIPPED = ROOT / "models/campaigns/candidate-drops.toml"


def test_noise_that_a_drop_does_not_state_is_the_study_s():
    shipped = candidates(SHIPPED, STUDY)
    assert list(shipped.noise) == [f.name for f in shipped.study.flights if f not in STUDY.flights]
    assert shipped.noise["short"] == STUDY.noise
    fine = shipped.noise["fine-positions"]
    assert (
        fine.canopy_position.white == 0.05
        and fine.model_copy(update={"canopy_position": STUDY.noise.canopy_position}) == STUDY.noise
    )
    sounded = shipped.noise["second-sounding"]
    assert sounded.slow_wind.horizontal == pytest.approx(0.3 * 0.3048) and sounded.wind == STUDY.noise.wind


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "short"', 'name = "cdt-3-11"', "name of a fitted flight"),
        (
            'name = "short"', 'name = "short"\nnoise = { riser_tension = { white = "1 kN", kind = "white" } }',
            "riser_tension, which it does not record",
        ),
        ('name = "short"', 'name = "short"\nnoise = { model = "white" }', "wanted the posterior's: 'latent'"),
        ('name = "short"', 'name = "short"\nnoise = { gusts = "2 m/s" }', "gusts"),
        ('name = "short"', 'name = "short"\nfile = "drop.csv"', "virtual"),
    ],
)  # fmt: skip
def test_faults_of_a_file_of_candidates(tmp_path, old, new, words):
    path, text = tmp_path / "drops.toml", SHIPPED.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        candidates(path, STUDY)


def test_a_study_s_flights_have_no_noise_of_their_own(tmp_path):
    """It is a drop's that might be flown; flights to be predicted are read by the same table without it."""
    from bayeschute.study.load import load_flights

    with pytest.raises(InputError, match="noise"):
        load_flights(SHIPPED, STUDY)
