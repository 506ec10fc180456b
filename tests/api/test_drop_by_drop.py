"""Drop by drop in Python and in the shell: what carries over, what begins anew, what is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import bayeschute as bc
from bayeschute.api.drop_by_drop import next_priors, taught_table
from bayeschute.cli import app
from bayeschute.likelihood.priors import Prior, correlated, covariance
from bayeschute.study.assembly.lessons import lessons


@pytest.fixture(scope="module")
def first(fitted):
    return bc.sample(fitted, draws=400, chains=2, warmup=100, seed=4)


@pytest.fixture(scope="module")
def second(first, sondes):
    return first.update(sondes.flights["high"], draws=400, chains=2, warmup=100)


def test_the_prior_of_the_second_drop_is_the_posterior_of_the_first(first, second):
    before = np.log(first["cds_over_mass"].values)
    told = second.taught()
    assert list(told.index) == [("low", "cds_over_mass"), ("high", "cds_over_mass")]
    row = told.loc[("high", "cds_over_mass")]
    assert row["prior_mean"] == pytest.approx(before.mean()) and row["prior_sd"] == pytest.approx(
        before.std(), rel=0.01
    )
    assert row["sd"] < row["prior_sd"] and row["logarithmic"]
    assert (
        set(told.attrs["joint"]) == {"low", "high"} and told.attrs["joint"]["low"] > told.attrs["joint"]["high"] > 0.0
    )
    assert "low" in second.as_priors().parameters[0].source and "high" in second.as_priors().parameters[0].source


def test_two_drops_of_one_body_say_more_than_either(first, second, sondes):
    """Both sondes fall at nearly the same rate; a fit that begins at the study's prior sees one of them only."""
    alone = bc.sample(bc.fit(sondes.flights["high"]), draws=400, chains=2, warmup=100, seed=4)
    a, b, both = (np.log(p["cds_over_mass"].values) for p in (first, alone, second))
    wanted = 1.0 / (1.0 / a.var() + 1.0 / b.var())
    assert both.std() == pytest.approx(np.sqrt(wanted), rel=0.2)
    assert both.mean() == pytest.approx(wanted * (a.mean() / a.var() + b.mean() / b.var()), abs=0.4 * both.std())


def test_a_drop_teaches_once(first, second, sondes, tmp_path):
    back = bc.Posterior.load(second.save(tmp_path / "two.nc"))
    assert len(back.taught()) == 2
    for posterior, name in ((first, "low"), (back, "low"), (back, "high")):
        with pytest.raises(bc.InputError, match="would count twice"):
            posterior.update(sondes.flights[name])


def test_what_can_not_be_carried_over_is_refused(first, sondes):
    with pytest.raises(bc.InputError, match="at least one"):
        first.update([])
    others = [sondes.flights["high"], sondes.flights["high"].changed(name="third")]
    with pytest.raises(bc.InputError, match="one at a time"):
        first.update(others)
    with pytest.raises(bc.InputError, match="of the posterior's: 'descent'"):
        first.update(bc.Study.example().flights[0])


def test_another_vehicle_keeps_coefficients_and_begins_its_masses_anew():
    study = bc.Study.example()
    flight = study.flights["cdt-3-12"]
    names = ("axial[1]", "riser_stiffness", "riser_damping", "riser_length")
    blank = [Prior(n, 0.0, 1.0, n.endswith(("stiffness", "damping")), "1", "") for n in names]
    law = np.diag([0.01, 0.1, 0.1, 0.1]) + 0.004
    made = bc.Priors(tuple(correlated(blank, np.array([0.9, 12.0, 12.0, 71.0]), law)), study.spec.priors)
    assert next_priors(made, study.spec, ["cdt-3-11"], [flight]) is made
    canopies = flight.vehicle.canopies.model_copy(update={"dry_mass": 2.0 * flight.vehicle.canopies.dry_mass})
    other = flight.changed(vehicle=flight.vehicle.model_copy(update={"canopies": canopies}))
    fresh = {p.name: p for p in next_priors(made, study.spec, ["cdt-3-11"], [other]).parameters}
    assert fresh["axial[1]"] == made.parameters[0]
    assert fresh["riser_length"].source == "given in the study" and set(fresh) == set(names)


def test_constant_errors_of_the_next_record_are_as_likely_as_those_of_the_first_were():
    """A flight's instruments tell nothing of another's, though they tell of the parameters that it shares."""
    study = bc.Study.example()
    given = study.spec.priors.given.model_copy(update={"wind_bias": SimpleNamespace(sd=2.0)})
    spec = replace(study.spec, priors=study.spec.priors.model_copy(update={"given": given}))
    blank = [Prior(n, 0.0, 1.0, False, "1", "") for n in ("axial[1]", "transverse[e]", "wind_bias.north@a")]
    law = np.diag([0.01, 0.1, 0.3]) + 0.02
    made = bc.Priors(tuple(correlated(blank, np.array([0.9, 0.1, 1.7]), law)), spec.priors)
    after = next_priors(made, spec, ["a"], [study.flights["cdt-3-12"]]).parameters
    assert [p.name for p in after] == ["axial[1]", "transverse[e]", "wind_bias.north", "wind_bias.east"]
    want = np.zeros((4, 4))
    want[:2, :2], want[2:, 2:] = law[:2, :2], 4.0 * np.eye(2)
    np.testing.assert_allclose(covariance(after), want, atol=1e-12)
    assert [p.centre for p in after[2:]] == [0.0, 0.0]


def test_lessons_are_of_the_parameters_of_one_fit(first):
    priors = [Prior("a", 0.0, 1.0, False, "1", "")]
    assert lessons(priors, {"a": np.zeros((2, 5)), "sd(a)": np.zeros((2, 5))}, ["x"]) == {}
    assert taught_table([]).empty


def _one(descents, name, other):
    """The study of one of the two flights."""
    text = descents.study.read_text(encoding="utf-8")
    made = re.sub(rf'\[\[flight\]\]\nname = "{other}".*?(?=\n\[)', "", text, flags=re.S)
    path = descents.study.with_name(f"only-{name}.toml")
    path.write_text(made, encoding="utf-8")
    return path


def test_the_shell_does_the_same(descents, tmp_path):
    run, made = CliRunner(), tmp_path / "low.nc"
    told = run.invoke(app, ["fit", str(_one(descents, "low", "high")), "--out", str(made), "--quick"])
    assert told.exit_code == 0, told.output
    after = [
        "fit",
        str(_one(descents, "high", "low")),
        "--prior",
        str(made),
        "--out",
        str(tmp_path / "both.nc"),
        "--quick",
    ]
    told = run.invoke(app, after)
    assert told.exit_code == 0, told.output
    assert "high taught" in told.output and "nats about all parameters" in told.output and "gain" in told.output
    assert list(bc.Posterior.load(tmp_path / "both.nc").taught().attrs["joint"]) == ["low", "high"]
    missing = run.invoke(app, [*after[:3], str(tmp_path / "none.nc"), "--out", str(tmp_path / "x.nc")])
    assert missing.exit_code == 2 and "no such file" in missing.output


def test_several_bodies_have_nothing_to_hand_on(sondes):
    posterior = bc.sample(bc.fit(sondes), draws=100, chains=2, warmup=50, seed=4)
    with pytest.raises(bc.InputError, match="one whose parameters all drops share"):
        replace(posterior).as_priors()


@pytest.mark.slow
def test_drops_of_a_cluster_one_by_one_are_nearly_the_fit_of_both():
    """Noise parameters are a drop's own in the one and shared in the other: means within a standard deviation."""
    study = bc.Study.example()
    first, second = (study.flights[n].changed(window=(0.0, end)) for n, end in (("cdt-3-11", 25.0), ("cdt-3-12", 20.0)))
    pool = {"axial": ("1", "alpha^2"), "transverse": ("e", "e*alpha^2", "rate", "repulsion(0.8)"), "fit": "pool"}
    few = study.candidates.model_copy(update=pool)
    priors = bc.Priors.from_structure(bc.select_structure(first, few), inflation=10.0) | study.priors
    one_by_one = bc.sample(bc.fit([first], priors), draws=2000).update([second], draws=2000)
    both = bc.sample(bc.fit([first, second], priors), draws=2000)
    for name in both.names:
        a, b = one_by_one[name].values, both[name].values
        assert abs(a.mean() - b.mean()) < b.std() and 0.75 < a.std() / b.std() < 1.33, name
    assert one_by_one.taught().loc["cdt-3-12", "gain"].max() < one_by_one.taught().loc["cdt-3-11", "gain"].max()
