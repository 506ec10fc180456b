"""Drops and canopies that differ about a population: how their fits are joined, what is kept, and what foretells which flight."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from arviz_base import from_dict

from bayeschute.core.errors import InputError
from bayeschute.dynamics.parameters import BIASES
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior.combine import hierarchy
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.study.assembly import populations
from bayeschute.study.assembly.canopies import each
from bayeschute.study.assembly.fits import Group
from bayeschute.study.load import check_study
from bayeschute.study.run import stage_data

CHAINS, DRAWS = 4, 250
PRIORS = (
    Prior("axial[1]", 0.9, 0.3, False, "1", "x"),
    Prior("riser_damping", 5.0, 0.5, True, "N s/m", "x"),
    Prior("transverse[e]", -0.2, 0.2, False, "1", "x"),
)
VARY = ("riser_damping", "axial[1]")
MEANS = np.array([[1.1, 5.3, -0.1], [0.7, 4.8, -0.12], [0.9, 5.1, -0.08]])
COVARIANCE = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.0], [0.5, 0.0, 1.0]]) * 1e-3


@dataclass(frozen=True)
class Fit:
    """What `load_fit` gives, as far as populations look at it."""

    theta: np.ndarray
    held: np.ndarray
    noise_effect: NoiseEffect


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Three drops that were fitted, their draws exactly of the wanted mean and covariance."""
    rng, flights = np.random.default_rng(2), [SimpleNamespace(name=f"drop-{i}") for i in range(3)]
    todo = [Group(f.name, (f,), PRIORS) for f in flights]
    fits = {}
    for group, mean in zip(todo, MEANS, strict=True):
        z = rng.standard_normal((CHAINS * DRAWS, 3))
        z = np.linalg.solve(np.linalg.cholesky(np.cov(z, rowvar=False)), (z - z.mean(axis=0)).T).T
        theta = (mean + z @ np.linalg.cholesky(COVARIANCE).T).reshape(CHAINS, DRAWS, 3)
        fits[group.name] = Fit(theta, theta + 1.0, NoiseEffect(np.ones((3, 2)), np.ones((2, 3, 3)), np.eye(3)))
    monkeypatch.setattr(populations, "load_fit", lambda job, group: fits[group.name])
    study = SimpleNamespace(
        model="cluster", seed=4, priors=SimpleNamespace(vary=VARY, vary_canopies=None, spread=None), predict=SimpleNamespace(draws=400),
        sampler=SimpleNamespace(chains=CHAINS, warmup=200, draws=DRAWS), with_role=lambda role: tuple(flights),
    )  # fmt: skip
    (tmp_path / "fit").mkdir()
    job = SimpleNamespace(study=study, out=tmp_path)
    monkeypatch.setattr(populations, "groups", lambda job: todo)
    trees = []
    for group in todo:
        flight = np.zeros((CHAINS, DRAWS, 5 + len(trees)))
        own = {p.name: p.value(fits[group.name].theta[..., i]) for i, p in enumerate(PRIORS)}
        trees.append(from_dict({"conditional": own, "log_likelihood": {group.name: flight}}))
    return SimpleNamespace(job=job, todo=todo, fits=fits, trees=trees)


@pytest.fixture
def joined(case: SimpleNamespace) -> xr.DataTree:
    return populations.joined(case.job, case.todo, case.trees)


def test_every_parameter_has_the_name_of_what_it_is(case, joined):
    drops = {f"{name}@{group.name}" for group in case.todo for name in VARY}
    wanted = {p.name for p in PRIORS} | {"sd(axial[1])", "sd(riser_damping)"} | drops
    assert set(joined["posterior"].data_vars) == set(joined["prior"].data_vars) == wanted
    assert set(joined["conditional"].data_vars) == {f"{p.name}@{g.name}" for p in PRIORS for g in case.todo}
    units = {name: joined["posterior"][name].attrs["units"] for name in wanted}
    assert units["riser_damping"] == units["riser_damping@drop-1"] == "N s/m" and units["sd(riser_damping)"] == "1"
    assert joined["log_likelihood"]["drop-2"].shape == (CHAINS, DRAWS, 7)


def test_the_transitions_of_the_populations_draws_are_kept(joined):
    diverged = joined["sample_stats"][populations.DIVERGING]
    assert diverged.shape == (CHAINS, DRAWS) and diverged.dtype == bool and "populations" in diverged.attrs["draws"]
    assert float(diverged.mean()) < 0.01  # three drops, well known: no neck of a funnel


def test_draws_are_those_of_the_joined_fits(case, joined):
    """The same hierarchy, set up here with means and covariances that are known, has the same posterior."""
    centre, scale = np.array([p.centre for p in PRIORS]), np.array([p.scale for p in PRIORS])
    order, places = [2, 0, 1], [[1 + d, 4 + d, 0] for d in range(3)]  # shared, then members of axial[1], of the other
    told = hierarchy.joint([hierarchy.likelihood_of(mean, COVARIANCE, centre, scale) for mean in MEANS], places, 7)
    made = hierarchy.fit(told, (3, 3), centre[order], scale[order], scale[order[1:]], 4, 500, 2000, 9)
    posterior = joined["posterior"].ds
    shared, axial, damping = made.shared[..., 0], made.mean[..., 0], made.mean[..., 1]
    pairs = [(shared, posterior["transverse[e]"]), (axial, posterior["axial[1]"])]
    pairs += [(damping, np.log(posterior["riser_damping"])), (made.sd[..., 1], posterior["sd(riser_damping)"])]
    pairs += [(made.members[..., 1], posterior["axial[1]@drop-1"])]
    for known, found in pairs:
        assert abs(float(found.mean()) - known.mean()) < 0.2 * known.std()
        assert float(found.std()) == pytest.approx(known.std(), rel=0.2)


def test_prior_draws_are_those_of_the_hierarchy(joined):
    before = joined["prior"].ds
    assert float(before["axial[1]"].std()) == pytest.approx(0.3, rel=0.1)
    assert float(before["sd(axial[1])"].mean()) == pytest.approx(0.3 * np.sqrt(2.0 / np.pi), rel=0.1)
    apart = before["axial[1]@drop-0"] - before["axial[1]"]
    assert float(apart.std()) == pytest.approx(0.3, rel=0.1)
    assert float(xr.corr(before["axial[1]@drop-0"], before["axial[1]@drop-1"])) == pytest.approx(0.5, abs=0.1)
    assert (before["riser_damping"] > 0.0).all()


def test_a_drop_that_was_flown_is_foretold_by_its_own_parameters(case, joined):
    ((group, stored, draws),) = populations.by_members(case.job, case.todo[1], case.fits["drop-1"], True, 400)
    assert group is case.todo[1] and draws == 400
    assert (
        not any(part.any() for part in stored.noise_effect[:3])
        and stored.noise_effect.misfit is None
        and (stored.held == stored.theta).all()
    )
    for i, name in ((0, "axial[1]@drop-1"), (2, "transverse[e]")):
        assert np.sort(stored.theta[..., i].ravel()) == pytest.approx(np.sort(joined["posterior"][name].values.ravel()))


def test_one_that_was_not_is_foretold_by_another_drop_of_the_population(case, joined):
    told = populations.by_members(case.job, case.todo[0], case.fits["drop-0"], False, 400)
    assert [group.name for group, _, _ in told] == ["drop-0", "drop-1", "drop-2"]
    assert [draws for *_, draws in told] == [134, 133, 133]
    posterior = joined["posterior"].ds
    spread = np.sqrt(float(posterior["axial[1]"].var() + (posterior["sd(axial[1])"] ** 2).mean()))
    for _, stored, _ in told:
        assert stored.theta[..., 0].std() == pytest.approx(spread, rel=0.3)
        assert spread > 2.0 * float(posterior["axial[1]@drop-1"].std())
    assert not np.isclose(told[0][1].theta[..., 2], told[1][1].theta[..., 2]).all()


def test_parameters_keep_their_correlation_in_the_draws_that_foretell(case, joined):
    ((_, stored, _),) = populations.by_members(case.job, case.todo[1], case.fits["drop-1"], True, 400)
    posterior = joined["posterior"].ds
    known = float(xr.corr(posterior["axial[1]@drop-1"], posterior["transverse[e]"]))
    assert np.corrcoef(stored.theta[..., 0].ravel(), stored.theta[..., 2].ravel())[0, 1] == pytest.approx(known)


def test_names_that_no_parameter_has_are_told_before_the_fit():
    given = SimpleNamespace(**dict.fromkeys([*stage_data._GIVEN, *BIASES]))
    priors = SimpleNamespace(vary=("axial[1]", "q"), vary_canopies=None, given=given, inflation=1.0, floor=0.1)
    study = SimpleNamespace(priors=priors, structure=None, vehicle=None, knowledge=(), with_role=lambda role: ())
    selected = {"coefficients": {"axial": {"selected": [{"term": "1", "estimate": 1.0, "se": 0.1}]}}}
    with pytest.raises(InputError, match=r"\[priors\] vary: got q; wanted .*axial\[1\]"):
        stage_data.priors(SimpleNamespace(study=study, load=lambda name: selected))


CANOPIES = each(PRIORS, ("axial[1]",), ["drop-0", "drop-1"], 2)  # four of the first parameter, then the other two


@pytest.fixture
def together(case: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Two drops that were fitted together, a coefficient of each of their canopies' own."""
    rng, size = np.random.default_rng(5), len(CANOPIES)
    mean = np.array([1.1, 0.9, 0.7, 1.0, 5.1, -0.1])
    spread = rng.standard_normal((size, size))
    covariance = 4e-3 * (np.eye(size) + 0.3 * spread @ spread.T)
    z = rng.standard_normal((CHAINS * DRAWS, size))
    z = np.linalg.solve(np.linalg.cholesky(np.cov(z, rowvar=False)), (z - z.mean(axis=0)).T).T
    theta = (mean + z @ np.linalg.cholesky(covariance).T).reshape(CHAINS, DRAWS, size)
    fit = Fit(theta, theta, NoiseEffect(np.ones((size, 2)), np.ones((2, size, size)), np.eye(size)))
    (group,) = todo = [Group("all", case.todo[0].flights + case.todo[1].flights, CANOPIES)]
    monkeypatch.setattr(populations, "load_fit", lambda job, group: fit)
    monkeypatch.setattr(populations, "groups", lambda job: todo)
    vars(case.job.study.priors).update(vary=None, vary_canopies=("axial[1]",), spread={"axial[1]": 0.2})
    own = {p.name: p.value(theta[..., i]) for i, p in enumerate(CANOPIES)}
    stats = {"diverging": np.zeros((CHAINS, DRAWS), bool)}
    tree = from_dict({"conditional": own, "sample_stats": stats, "log_likelihood": {"drop-0": np.zeros((4, 250, 5))}})
    return SimpleNamespace(
        job=case.job, group=group, fit=fit, mean=mean, covariance=covariance,
        tree=populations.joined(case.job, todo, [tree]),
    )  # fmt: skip


def test_canopies_have_the_names_of_drop_and_canopy(together):
    posterior = together.tree["posterior"].ds
    own = {p.name for p in CANOPIES[:4]}
    assert set(posterior.data_vars) == {p.name for p in PRIORS} | {"sd(axial[1])"} | own
    assert set(together.tree["prior"].data_vars) == set(posterior.data_vars)
    assert set(together.tree["conditional"].data_vars) == {p.name for p in CANOPIES}
    assert posterior["axial[1]@drop-1.canopy2"].attrs["units"] == "1"
    assert "diverging" in together.tree["sample_stats"]


def test_canopies_draw_each_other_towards_their_mean(together):
    """Against the same posterior by quadrature over the standard deviation, from dense matrices."""
    scale = np.array([0.3, 0.3, 0.3, 0.3, 0.5, 0.2])
    centre = np.array([0.9, 0.9, 0.9, 0.9, 5.0, -0.2])
    precision = np.linalg.inv(together.covariance)
    told = precision @ together.mean - centre / scale**2
    precision = precision - np.diag(scale**-2.0)
    rows = []
    for sd in np.linspace(0.005, 1.2, 120):
        prior = np.diag(scale**2)
        prior[:4, :4] = 0.3**2 + sd**2 * np.eye(4)
        both = np.linalg.inv(precision + np.linalg.inv(prior))
        shift = told + np.linalg.solve(prior, centre)
        log = 0.5 * shift @ both @ shift + 0.5 * np.linalg.slogdet(both)[1] - 0.5 * np.linalg.slogdet(prior)[1]
        log -= 0.5 * centre @ np.linalg.solve(prior, centre)
        rows.append((log - 0.5 * (sd / 0.2) ** 2, both @ shift, np.diag(both), sd))
    log, means, variances, sds = (np.array(column) for column in zip(*rows, strict=True))
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ means
    width = np.sqrt(weight @ (variances + (means - mean) ** 2))
    posterior = together.tree["posterior"].ds
    for i, p in enumerate(CANOPIES):
        drawn = np.log(posterior[p.name]) if p.logarithmic else posterior[p.name]
        assert abs(float(drawn.mean()) - mean[i]) < 0.15 * width[i]
        assert float(drawn.std()) == pytest.approx(width[i], rel=0.12)
    assert float(posterior["sd(axial[1])"].mean()) == pytest.approx(weight @ sds, rel=0.1)
    before = together.tree["prior"].ds["sd(axial[1])"]
    assert float(before.mean()) == pytest.approx(0.2 * np.sqrt(2.0 / np.pi), rel=0.1)


def test_a_flight_that_was_fitted_is_foretold_by_its_own_canopies(together):
    ((group, stored, draws),) = populations.by_members(together.job, together.group, together.fit, True, 400)
    assert group is together.group and draws == 400
    posterior = together.tree["posterior"].ds
    for i, name in ((3, "axial[1]@drop-1.canopy2"), (5, "transverse[e]")):
        assert np.sort(stored.theta[..., i].ravel()) == pytest.approx(np.sort(posterior[name].values.ravel()))


def test_one_that_was_not_is_foretold_by_further_canopies(together):
    ((_, stored, _),) = populations.by_members(together.job, together.group, together.fit, False, 400)
    posterior = together.tree["posterior"].ds
    spread = np.sqrt(float(posterior["axial[1]"].var() + (posterior["sd(axial[1])"] ** 2).mean()))
    alike = float(posterior["axial[1]"].var()) / spread**2
    first, second = stored.theta[..., 0].ravel(), stored.theta[..., 1].ravel()
    assert first.std() == pytest.approx(spread, rel=0.15) and second.std() == pytest.approx(spread, rel=0.15)
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(alike, abs=0.15)


def test_canopies_of_drops_that_have_a_parameter_of_their_own():
    """Both tables: places of shared parameters, drops and canopies in every fit."""
    todo = [Group(f"drop-{d}", (), each(PRIORS, ("axial[1]",), [f"drop-{d}"], 2)) for d in range(2)]
    made = populations._places(("riser_damping",), todo)
    assert made.shared == ("transverse[e]",) and made.populations == ("axial[1]", "riser_damping")
    assert made.members == (*(p.name for p in CANOPIES[:4]), "riser_damping@drop-0", "riser_damping@drop-1")
    assert made.of == (0, 0, 0, 0, 1, 1)
    assert made.fits == ((1, 2, 5, 0), (3, 4, 6, 0))


STUDY = Path(__file__).parents[3] / "models" / "studies" / "cdt-3-11.toml"


def asking(folder: Path, vary: str, more: str) -> list[str]:
    text = STUDY.read_text(encoding="utf-8").replace("../vehicles", str(STUDY.parents[1] / "vehicles"))
    text = text.replace("inflation = 10.0", f"vary = {vary}\ninflation = 10.0")
    text = text.replace('fit = "search"', more)
    (folder / "drops.toml").write_text(text, encoding="utf-8")
    return [str(fault) for fault in check_study(folder / "drops.toml")]


@pytest.mark.parametrize(
    ("vary", "more", "told"),
    [
        ('["axial[1]"]', 'fit = "pool"', "two flights at least"),
        ("[]", 'fit = "pool"', "one at least"),
        ('["axial[1]", "axial[1]"]', 'fit = "pool"', "each only once"),
        ('["axial[1]"]', 'fit = "selected"\nstack = 3', "one of the two"),
    ],
)
def test_what_can_not_be_joined_is_a_fault(tmp_path, vary, more, told):
    found = asking(tmp_path, vary, more)
    assert any("[priors] vary" in fault and told in fault for fault in found), found
