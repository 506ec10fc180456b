"""Studies as plain values and back."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bayeschute.core.errors import InputError
from bayeschute.study.archive import study_from_plain, study_to_plain
from bayeschute.study.load import load_study
from bayeschute.study.study import study_hash

STUDIES = sorted((Path(__file__).parents[2] / "models" / "studies").glob("*.toml"))


@pytest.mark.parametrize("path", STUDIES, ids=lambda p: p.stem)
def test_every_shipped_study_comes_back_as_it_was(path):
    try:
        study = load_study(path)
    except InputError:
        pytest.skip("its records are not here")
    back = study_from_plain(json.loads(json.dumps(study_to_plain(study))))
    assert study_hash(back) == study_hash(study)
    for name in ("flights", "priors", "noise", "vehicle", "structure", "requirements", "predict", "text"):
        assert getattr(back, name) == getattr(study, name), name


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda plain: plain["flights"][0].update(rate="fast"), r"study\.flights\[0\]\.rate"),
        (lambda plain: plain.update(seed=1.5), r"study\.seed"),
        (lambda plain: plain.update(model=["cluster"]), r"study\.model"),
        (lambda plain: plain["noise"].update(unheard_of=1), r"study\.noise"),
        (lambda plain: plain.pop("noise"), "study"),
        (lambda plain: plain["flights"][0].update(window=[1.0]), r"study\.flights\[0\]\.window"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_place(change, where):
    plain = json.loads(json.dumps(study_to_plain(load_study(STUDIES[0].with_name("cdt-3-11.toml")))))
    change(plain)
    with pytest.raises(InputError, match=where):
        study_from_plain(plain)
