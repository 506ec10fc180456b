"""A fit that was stopped goes on to the same draws, bit by bit; what was kept for something else is not used."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import numpy as np
import pytest
import xarray as xr

from bayeschute.likelihood.joint import Lifted, NoiseParameters, Unknowns
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.fit.drawn_density import Sampled
from bayeschute.posterior.fit.joint_fit import JointFit
from bayeschute.posterior.joint_mode import Optimum
from bayeschute.posterior.marginal import Quadratic
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.study.run import stage_fit
from bayeschute.study.run.fit import checkpoint, settled_terms
from bayeschute.study.run.stages import run_study

RNG = np.random.default_rng(5)
PRIORS = [Prior("a", 0.1, 0.2, False, "1", "x"), Prior("b", 1.0 / 3.0, 0.2, True, "m", "y")]
FLIGHTS = tuple(
    Lifted(Unknowns(RNG.standard_normal(3), RNG.standard_normal((4, 2))), *RNG.standard_normal((2, 4, 5))) for _ in range(2)
)  # fmt: skip
BEST = Optimum(RNG.standard_normal(2), FLIGHTS, np.eye(2), 1.0 / 7.0, True, 5, 0.01, (3.0, 2.0))
HYPER = NoiseParameters(Noise(*RNG.random((3, 2))), (RNG.random(2), RNG.random(3)))


def job(tmp_path, digest="a"):
    return SimpleNamespace(out=tmp_path, hash=digest)


def test_an_optimum_comes_back_to_the_bit(tmp_path):
    checkpoint.put_settled(job(tmp_path), "one", PRIORS, JointFit(BEST, HYPER, -2.0 / 3.0), {"c": 1.1})
    priors, settled, scores = checkpoint.get_settled(job(tmp_path), "one")
    assert priors == PRIORS and scores == {"c": 1.1} and settled.evidence == -2.0 / 3.0
    np.testing.assert_array_equal(settled.optimum.theta, BEST.theta)
    assert (settled.optimum.cost, settled.optimum.trace) == (BEST.cost, BEST.trace)
    jax.tree.map(np.testing.assert_array_equal, settled.optimum.flights, FLIGHTS)
    np.testing.assert_array_equal(settled.hyper.noise.correlated, HYPER.noise.correlated)
    assert len(settled.hyper.disturbance_parameters) == 2
    np.testing.assert_array_equal(settled.hyper.disturbance_parameters[1], HYPER.disturbance_parameters[1])


def test_draws_come_back_to_the_bit(tmp_path):
    made = Draws(RNG.random((2, 3, 4)), RNG.random((2, 3)), {"diverging": np.zeros((2, 3), bool)}, 1, 99, ("a note",))
    drawn = Sampled(made, Quadratic(RNG.random(4), RNG.random((4, 4))), 0.1)
    checkpoint.put_draws(job(tmp_path), "one", "nuts", drawn)
    back, bend, shift = checkpoint.get_draws(job(tmp_path), "one", "nuts")
    assert shift == 0.1
    jax.tree.map(np.testing.assert_array_equal, bend, drawn.bend)
    np.testing.assert_array_equal(back.xi, made.xi)
    assert back.stats["diverging"].dtype == bool and back.notes == made.notes
    assert (back.failed, back.evaluations) == (1, 99)
    assert checkpoint.get_draws(job(tmp_path), "one", "emcee") is None


def test_what_was_kept_for_another_run_is_refused(tmp_path):
    checkpoint.put_settled(job(tmp_path), "one", PRIORS, JointFit(BEST, HYPER, 0.0), {})
    assert checkpoint.get_settled(job(tmp_path, "b"), "one") is None
    checkpoint.clear(job(tmp_path))
    assert checkpoint.get_settled(job(tmp_path), "one") is None


class Killed(BaseException):
    """Stands for the end of the process."""


def test_a_stopped_fit_goes_on_to_the_same_draws(descents, finished, tmp_path, monkeypatch):
    """Two descents; killed while the second is sampled. The first is not fitted again, the second not optimised again."""
    sample, joint_fit, calls = stage_fit.sample, settled_terms.joint_fit, []

    def killed(*given):
        calls.append("sample")
        if len(calls) > 1:
            raise Killed
        return sample(*given)

    monkeypatch.setattr(stage_fit, "sample", killed)
    with pytest.raises(Killed):
        run_study(descents.study, tmp_path / "run", until="fit")

    def counted(name, function):
        return lambda *given: (calls.append(name), function(*given))[1]

    calls.clear()
    monkeypatch.setattr(stage_fit, "sample", counted("sample", sample))
    monkeypatch.setattr(settled_terms, "joint_fit", counted("settle", joint_fit))
    run_study(descents.study, tmp_path / "run", until="fit", resume=True)
    assert calls == ["sample"]
    with (
        xr.open_datatree(tmp_path / "run/posterior.nc", engine="h5netcdf") as made,
        xr.open_datatree(finished.folder / "posterior.nc", engine="h5netcdf") as wanted,
    ):
        for group in ("posterior", "sample_stats", "posterior_predictive"):
            if group in wanted.children:
                xr.testing.assert_equal(made[group].to_dataset(), wanted[group].to_dataset())
    assert not (tmp_path / "run/fit/kept").exists()


def test_with_force_nothing_kept_is_used(descents, tmp_path, monkeypatch):
    used = []
    monkeypatch.setattr(checkpoint, "get_settled", lambda job, name: used.append((tmp_path / "run/fit/kept").exists()))
    (tmp_path / "run/.stages").mkdir(parents=True)
    (tmp_path / "run/fit/kept").mkdir(parents=True)
    monkeypatch.setattr(settled_terms, "settle", lambda *given: (_ for _ in ()).throw(Killed))
    with pytest.raises(Killed):
        run_study(descents.study, tmp_path / "run", until="fit", force=True)
    assert used == [False]
