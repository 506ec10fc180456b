"""A run in progress: what stages leave for each other, and how far along a part is of the whole."""

from __future__ import annotations

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from bayeschute.likelihood.priors import Prior
from bayeschute.study.job import Job, load_priors, load_truth, part_of

PRIOR = Prior("cds_over_mass", -2.0, 0.4, True, "m^2/kg", "a guess", {"riser_length": 0.3}, 0.0, 1.5)


@pytest.fixture
def job(tmp_path):
    told = []
    made = Job(SimpleNamespace(), tmp_path, False, "", lambda *said: told.append(said))
    object.__setattr__(made, "told", told)
    return made


def test_parts_in_parts_go_from_start_to_end(job):
    inner = part_of(part_of(job.say("fit"), 0.2, 0.8), 0.5, 1.0)
    for share in (0.0, 0.5, 1.0):
        inner(share, "words")
    assert [stage for stage, _, _ in job.told] == ["fit"] * 3 and job.told[0][2] == "words"
    assert [share for _, share, _ in job.told] == pytest.approx([0.5, 0.65, 0.8])


def test_priors_that_the_fit_revised_go_before_those_it_began_with(job):
    job.save("priors.json", [asdict(PRIOR)])
    assert load_priors(job) == [PRIOR]
    (job.out / "fit").mkdir()
    revised = PRIOR.__class__("axial[1]", 0.85, 0.1, False, "1", "the fit")
    job.save("fit/priors.json", [asdict(PRIOR), asdict(revised)])
    assert load_priors(job) == [PRIOR, revised]


def test_a_value_comes_back_as_it_was_to_the_last_digit(job):
    value = {"a": [0.1 + 0.2, 1e-300, None, True], "β": {"c": "x"}}
    job.save("one.json", value)
    assert job.load("one.json") == value and [p.name for p in job.out.iterdir()] == ["one.json"]


def test_what_is_no_json_leaves_what_was_there(job):
    job.save("one.json", [1])
    with pytest.raises(TypeError):
        job.save("one.json", {"a": object()})
    assert job.load("one.json") == [1] and [p.name for p in job.out.iterdir()] == ["one.json"]


def test_only_a_virtual_flight_has_a_truth(job):
    (job.out / "flights").mkdir()
    truth = xr.Dataset({"swing_angle": ("time", np.arange(3.0))})
    truth.to_netcdf(job.out / "flights" / "low.truth.nc", engine="h5netcdf")
    xr.testing.assert_identical(load_truth(job, "low"), truth)
    assert load_truth(job, "high") is None
