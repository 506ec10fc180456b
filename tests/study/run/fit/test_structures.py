"""A stack of structures: which are fitted, how they are weighed and kept, and how their predictions are mixed."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.core.errors import FitError
from bayeschute.likelihood.joint import Lifted, NoiseParameters, Unknowns
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.fit.drawn_density import Sampled
from bayeschute.posterior.fit.joint_fit import JointFit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Quadratic
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.study.assembly.fits import Group
from bayeschute.study.load import check_study, load_study
from bayeschute.study.run.fit import checkpoint, structures
from bayeschute.study.study import canonical

RNG = np.random.default_rng(5)
HYPER = NoiseParameters(Noise(*RNG.random((3, 2))), (RNG.random(2),))
AXIAL = {
    "selected": [{"term": "1", "estimate": 0.9, "se": 0.01}],
    "structures": [
        {"terms": ["1", "q"], "share": 0.5, "estimate": [0.8, 0.1], "se": [0.02, 0.03]},
        {"terms": ["1"], "share": 0.4, "estimate": [0.9], "se": [0.01]},
    ],
}
TRANSVERSE = {
    "selected": [{"term": "rate", "estimate": -0.1, "se": 0.01}, {"term": "e", "estimate": 0.2, "se": 0.01}],
    "structures": [
        {"terms": ["e"], "share": 0.6, "estimate": [0.3], "se": [0.05]},
        {"terms": ["e", "rate"], "share": 0.2, "estimate": [0.2, -0.1], "se": [0.01, 0.01]},
    ],
}
NAMES = ("axial[1]", "transverse[rate]", "transverse[e]", "riser_length")
PRIORS = [Prior(name, 0.1, 0.2, False, "1", "x") for name in NAMES]


@pytest.fixture
def job(tmp_path: Path) -> SimpleNamespace:
    """A run whose structure and priors are known."""
    (tmp_path / "fit").mkdir()
    files = {"structure.json": {"coefficients": {"axial": AXIAL, "transverse": TRANSVERSE}}}
    files |= {"priors.json": [p.__dict__ for p in PRIORS]}
    for name, value in files.items():
        (tmp_path / name).write_text(json.dumps(value), encoding="utf-8")
    flight = SimpleNamespace(name="drop")
    structure = SimpleNamespace(stack=3, axial=("1", "q"), transverse=("rate", "e"))
    study = SimpleNamespace(
        structure=structure, priors=SimpleNamespace(inflation=2.0, floor=0.05), seed=4,
        with_role=lambda role: (flight,), sampler=SimpleNamespace(kind="nuts"),
    )  # fmt: skip
    return SimpleNamespace(
        study=study, out=tmp_path, hash="a", quick=False,
        load=lambda name: json.loads((tmp_path / name).read_text(encoding="utf-8")),
        save=lambda name, value: (tmp_path / name).write_text(json.dumps(value), encoding="utf-8"),
    )  # fmt: skip


def test_the_selected_structure_is_first_then_those_most_often_selected(job):
    made = structures.candidates(job)
    assert [c.terms for c in made] == [
        {"axial": ("1",), "transverse": ("rate", "e")},
        {"axial": ("1", "q"), "transverse": ("e",)},
        {"axial": ("1",), "transverse": ("e",)},
    ]
    assert [c.share for c in made] == pytest.approx([0.4 * 0.2, 0.5 * 0.6, 0.4 * 0.6])
    assert made[0].priors == tuple(PRIORS)
    one, two, three, last = made[1].priors
    assert [p.name for p in made[1].priors] == ["axial[1]", "axial[q]", "transverse[e]", "riser_length"]
    assert (one.centre, one.scale) == (0.8, 0.05) and (two.centre, two.scale) == (0.1, 0.06)
    assert (three.centre, three.scale) == (0.3, 0.1) and last == PRIORS[-1]


def test_no_more_are_fitted_than_there_are(job):
    job.study.structure.stack = 20
    made = structures.candidates(job)
    assert len(made) == 4 and len({json.dumps(c.terms) for c in made}) == 4


def _fitted(job, group, say):
    """A made-up fit: structures without e fail; with rate it foretells a little better."""
    names = [p.name for p in group.priors]
    if "axial[q]" in names:
        raise FloatingPointError("lost on purpose")
    size = len(names)
    flights = (Lifted(Unknowns(np.zeros(3), np.zeros((4, 2))), np.zeros((4, 2)), np.zeros((4, 5))),)
    best = Optimum(np.full(size, float(size)), flights, np.eye(size), 1.0, True, 5, 0.01, (2.0,))
    later = (0.05 if "transverse[rate]" in names else 0.0) + 0.0 * np.arange(100.0)
    draws = Draws(np.full((2, 3, size), float(size)), np.zeros((2, 3)), {}, 0, 6, ())
    drawn = Sampled(draws, Quadratic.none(size), 0.0)
    return structures._Fitted(JointFit(best, HYPER, 0.0), drawn, np.full(25, -1.0), later, True)


def test_structures_are_weighed_the_best_is_kept_and_what_failed_is_told(job, monkeypatch):
    monkeypatch.setattr(structures, "_fitted", _fitted)
    group = Group("all", (SimpleNamespace(name="drop"),), tuple(PRIORS))
    assert structures.fit_all(job, group, lambda share, words: None) == ["structure-1", "structure-2", "structure-3"]
    rows = structures.summary_rows(job)
    assert [r["name"] for r in rows] == ["structure-1", "structure-3", "structure-2"]
    assert rows[0]["weight"] + rows[1]["weight"] == pytest.approx(1.0) and rows[2]["weight"] == 0.0
    assert rows[0]["weight"] == pytest.approx(1.0 / (1.0 + np.exp(-5.0)), abs=1e-9)  # the same in every replicate
    assert rows[1]["behind"] == pytest.approx(-5.0) and rows[0]["log_evidence"] == pytest.approx(5.0 - 25.0)
    kept, settled, _ = checkpoint.get_settled(job, "all")
    assert tuple(kept) == tuple(PRIORS) and settled.optimum.theta[0] == 4.0
    assert checkpoint.get_draws(job, "all", "nuts").draws.xi.shape == (2, 3, 4)
    made = structures.members(job, group, 1000)
    assert [(one.name, draws) for one, draws in made] == [("structure-1", 993), ("structure-3", 7)]
    assert made[0][0].priors == tuple(PRIORS) and made[1][0].flights == group.flights
    verdict = structures.check(rows)
    assert not verdict["passed"] and verdict["value"] == 1.0
    (line,) = structures.note(rows)
    assert "0.99 (+0.0 +- 0.0): axial 1; transverse rate, e | 0.01 (-5.0 +- 0.0): axial 1; transverse e" in line
    assert "failed (lost on purpose): axial 1, q; transverse e" in line


def test_if_none_can_be_fitted_the_first_fault_is_raised(job, monkeypatch):
    def fails(*given):
        raise FloatingPointError("lost on purpose")

    monkeypatch.setattr(structures, "_fitted", fails)
    with pytest.raises(FloatingPointError, match=r"lost on purpose \(none of 3 structures could be fitted\)"):
        structures.fit_all(job, Group("all", (), tuple(PRIORS)), lambda share, words: None)


def test_if_none_can_be_fitted_the_best_flights_of_the_first_that_has_any_are_handed_on(job, monkeypatch):
    several = iter(
        (FloatingPointError("lost"), FitError("no rest", ("level 1",), ("a path",)), FloatingPointError("x"))
    )

    def fails(*given):
        raise next(several)

    monkeypatch.setattr(structures, "_fitted", fails)
    with pytest.raises(FitError, match=r"lost \(none of 3 structures could be fitted\)") as told:
        structures.fit_all(job, Group("all", (), tuple(PRIORS)), lambda share, words: None)
    assert told.value.paths == ("a path",)
    assert told.value.tried == ("structure-1: lost", "structure-2: no rest", "structure-3: x")


def test_a_structure_that_has_settled_is_not_fitted_again(job, monkeypatch):
    def forbidden(*given, **named):
        raise AssertionError("fitted again")

    monkeypatch.setattr(structures, "joint_fit", forbidden)
    job.study.sampler.starts = None
    flights = (Lifted(Unknowns(np.zeros(3), np.zeros((4, 2))), np.zeros((4, 2)), np.zeros((4, 5))),)
    best = Optimum(np.zeros(4), flights, np.eye(4), 1.0, True, 5, 0.01, (2.0,))
    group = Group("structure-1", (), tuple(PRIORS))
    checkpoint.put_settled(job, group.name, PRIORS, JointFit(best, HYPER, -2.5), {})
    assert structures._settled(job, group, None, lambda share, words: None).evidence == -2.5
    with pytest.raises(AssertionError, match="fitted again"):  # kept with other priors: another structure's
        structures._settled(job, Group("structure-1", (), tuple(PRIORS[:3])), None, lambda share, words: None)


def test_one_structure_alone_predicts_as_before(job):
    group = Group("all", (), tuple(PRIORS))
    assert structures.members(job, group, 64) == [(group, 64)] and structures.summary_rows(job) == []
    assert structures.note([]) == []


FAULTS = [
    ("stack = 1", "[structure] stack", "1", "from 2"),
    ("stack = 2", "structure", 'stack together with fit = "search"', "a stack of selected structures"),
    ('fit = "pool"\nstack = 2', "structure", 'stack together with fit = "pool"', "a stack of selected structures"),
    ('fit = "selected"\nstack = 2\nreplicates = 0', "structure", "stack together with replicates = 0", "replicates, w"),
]


@pytest.mark.parametrize(("new", "where", "got", "wanted"), FAULTS)
def test_faults_are_named(cluster: Path, spoil, new: str, where: str, got: str, wanted: str):
    (fault,) = check_study(spoil(cluster, r"^fit = .*" if "fit" in new else r"^(?=sigma_max)", new + "\n"))
    told = str(fault)
    assert where in told.split(": got")[0] and got in told and wanted in told


def test_the_sandwich_can_not_be_stacked(cluster: Path, spoil):
    spoil(cluster, r"^fit = .*", 'fit = "selected"\nstack = 2')
    assert check_study(cluster) == []
    assert canonical(load_study(cluster))["structure"]["stack"] == 2
    spoil(cluster, r"^\[noise\]", '[noise]\nmodel = "sandwich"')
    faults = "\n".join(map(str, check_study(cluster)))
    assert "[structure] stack" in faults and "another noise model" in faults


def test_what_is_not_asked_for_leaves_no_trace(cluster: Path):
    assert "stack" not in canonical(load_study(cluster))["structure"]
