"""What a study takes as known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bayeschute.study.load import load_study
from bayeschute.study.study import apparent_mass_taken_as_known
from bayeschute.study.templates import template


@pytest.fixture(scope="module")
def virtual():
    return load_study(template("virtual.toml"))


def test_an_apparent_mass_that_is_not_fitted_is_told_of_flights_that_were_flown(virtual):
    assert virtual.priors.given.enclosed_air_factor is None
    assert apparent_mass_taken_as_known(virtual) == []  # its simulator knows it
    flown = replace(virtual, flights=tuple(replace(flight, virtual=None) for flight in virtual.flights))
    (note,) = apparent_mass_taken_as_known(flown)
    assert "taken as known" in note and "enclosed_air_factor in [priors.given]" in note


def test_one_that_is_fitted_is_not(virtual):
    given = virtual.priors.given.model_copy(update={"enclosed_air_factor": object()})
    fitted = replace(
        virtual,
        flights=tuple(replace(flight, virtual=None) for flight in virtual.flights),
        priors=virtual.priors.model_copy(update={"given": given}),
    )
    assert apparent_mass_taken_as_known(fitted) == []
