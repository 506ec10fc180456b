from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy import stats

from bayeschute.core.errors import InputError
from bayeschute.prediction import risk_files

UNITS = {"axial[1]": "1", "riser_stiffness": "N/m"}


@pytest.fixture
def draws():
    rng = np.random.default_rng(3)
    a = rng.normal(0.95, 0.01, (4, 300))
    return {"axial[1]": a, "riser_stiffness": np.exp(12.3 + 10 * (a - 0.95) + 0.1 * rng.normal(size=a.shape))}


@pytest.fixture
def final():
    rng = np.random.default_rng(4)
    rate = rng.normal(9.8, 0.2, 1000)
    rate[[3, 7]] = np.nan
    return {"cdt-3-12": {"descent_rate": rate * 1.02, "sea_level_descent_rate": rate}}


def test_draws_come_back_with_units(tmp_path, draws):
    tmp_path = tmp_path / "made" / "where missing"
    table = risk_files.write_draws(draws, tmp_path, UNITS)
    back = pd.read_parquet(tmp_path / "draws.parquet")
    pd.testing.assert_frame_equal(back, table)
    assert back.attrs["units"] == UNITS
    assert pq.read_schema(tmp_path / "draws.parquet").field("riser_stiffness").metadata[b"unit"] == b"N/m"
    plain = pd.read_csv(tmp_path / "draws.csv")
    pd.testing.assert_frame_equal(plain, table, check_exact=True)
    assert dict(pd.read_csv(tmp_path / "draws_units.csv", dtype=str).values) == UNITS
    chain_2 = table[table.chain == 2].sort_values("draw")["axial[1]"]
    np.testing.assert_array_equal(chain_2, draws["axial[1]"][2])


def test_draws_of_two_shapes_are_refused():
    with pytest.raises(InputError, match="one shape"):
        risk_files.draws_table({"a": np.zeros((2, 3)), "b": np.zeros((2, 4))})


def test_marginals_and_correlation(draws):
    table = risk_files.draws_table(draws)
    rows = risk_files.marginal_table(table, UNITS, {"riser_stiffness": (0.0, np.inf)}, {"axial[1]": 700.0}).set_index(
        "parameter"
    )
    stiffness = rows.loc["riser_stiffness"]
    assert stiffness.family == "lognormal"
    assert stiffness.location == pytest.approx(12.3, abs=0.02)
    assert stiffness.q50 == pytest.approx(np.median(draws["riser_stiffness"]))
    assert stiffness.fit_q99865 == pytest.approx(np.exp(stiffness.location + 3 * stiffness.scale), rel=1e-3)
    assert rows.loc["axial[1]", "independent_draws"] == 700
    matrix = risk_files.correlation_table(table)
    assert matrix.loc["axial[1]", "axial[1]"] == pytest.approx(1.0)
    expected = np.corrcoef(draws["axial[1]"].ravel(), draws["riser_stiffness"].ravel())[0, 1]
    assert matrix.loc["axial[1]", "riser_stiffness"] == pytest.approx(expected)


def test_exceedance_counts_failed_solves_against_us(final):
    rows = risk_files.exceedance_table(risk_files.samples_table(final), "final", {"sea_level_descent_rate": [10.0]})
    row = rows[(rows.quantity == "sea_level_descent_rate") & (rows.threshold == 10.0)].iloc[0]
    rate = final["cdt-3-12"]["sea_level_descent_rate"]
    count = int((rate > 10.0).sum()) + 2
    assert (row.exceeded, row.failed, row.draws) == (count, 2, 1000)
    limits = stats.binomtest(count, 1000).proportion_ci(0.9, method="exact")
    assert (row.clopper_pearson_low, row.clopper_pearson_high) == pytest.approx((limits.low, limits.high))
    assert (row.credible_low, row.credible_high) == pytest.approx(
        stats.beta(count + 0.5, 1000.5 - count).ppf([0.05, 0.95])
    )
    part = rows[rows.quantity == "sea_level_descent_rate"]
    assert (part.threshold.diff().dropna() > 0).all()
    assert (part.probability.diff().dropna() <= 0).all()


def test_dependent_draws_widen_the_limits(final):
    samples = risk_files.samples_table(final)
    wide = risk_files.exceedance_table(samples, "final", independent=100)
    narrow = risk_files.exceedance_table(samples, "final")
    middle = len(narrow) // 4
    width = wide.clopper_pearson_high - wide.clopper_pearson_low
    assert width[middle] > 2.5 * (narrow.clopper_pearson_high - narrow.clopper_pearson_low)[middle]


def test_tolerance_takes_the_order_statistic():
    x = np.random.default_rng(5).permutation(np.arange(1000.0))
    table = risk_files.tolerance_table(risk_files.samples_table({"a": {"descent_rate": x}}), "final")
    row = table[(table.share == 0.95) & (table.failures == 2)].iloc[0]
    assert (row.needed, row.enough, row.limit) == (124, True, 997.0)
    few = table[(table.share == 0.99865) & (table.failures == 0)].iloc[0]
    assert (few.needed, few.enough) == (1705, False)
    assert np.isnan(few.limit)
    most = table[table.share == 0.95].iloc[-1]
    assert most.needed <= 1000 < risk_files.wilks_sample_size(0.95, 0.95, int(most.failures) + 1)
    assert most.limit == 999.0 - most.failures


def test_tolerance_with_a_failed_solve_has_no_limit(final):
    table = risk_files.tolerance_table(risk_files.samples_table(final), "final")
    rows = table[(table.quantity == "sea_level_descent_rate") & (table.share == 0.95)]
    assert np.isinf(rows[rows.failures == 0].limit.iloc[0])
    assert np.isfinite(rows[rows.failures == 2].limit.iloc[0])


def test_requirement_over_single_draws():
    x = np.r_[np.full(90, 9.0), np.full(8, 11.0), [np.nan, np.nan]]
    check = risk_files.requirement_check(x, name="rate", quantity="sea_level_descent_rate", unit="m/s", at_most=10.0)
    limits = stats.binomtest(90, 100).proportion_ci(0.9, method="exact")
    assert check["probability_met"] == 0.9
    assert (check["simulation_low"], check["simulation_high"]) == pytest.approx((limits.low, limits.high))
    assert (check["failed"], check["met"], check["draws"], check["median"], check["margin"]) == (2, 90, 100, 9.0, 1.0)
    assert check["posterior_sd"] is None
    turned = risk_files.requirement_check(-x, name="rate", quantity="q", unit="m/s", at_least=-10.0)
    assert (turned["probability_met"], turned["margin"]) == (0.9, 1.0)


def test_requirement_tells_posterior_from_simulation():
    rng = np.random.default_rng(6)
    p = rng.beta(8.0, 2.0, 400)
    few = rng.random((400, 5)) < p[:, None]
    many = rng.random((400, 200)) < p[:, None]
    truth = stats.beta(8.0, 2.0)
    for met, tolerance in ((few, 0.08), (many, 0.03)):
        x = np.where(met, 0.0, 2.0)
        check = risk_files.requirement_check(x, name="a", quantity="q", unit="1", at_most=1.0, confidence=0.99)
        assert check["posterior_sd"] == pytest.approx(truth.std(), rel=0.15)
        assert (check["posterior_q05"], check["posterior_q95"]) == pytest.approx(truth.ppf([0.05, 0.95]), abs=tolerance)
        assert check["simulation_low"] < 0.8 < check["simulation_high"]
        assert 400 <= check["independent_simulations"] <= met.size
    same = rng.random((400, 50)) < 0.9  # the parameters don't matter: flights are independent
    check = risk_files.requirement_check(np.where(same, 0.0, 2.0), name="a", quantity="q", unit="1", at_most=1.0)
    assert check["posterior_sd"] < 0.02
    assert check["independent_simulations"] > 10_000
    lost = risk_files.requirement_check(np.full(5, np.nan), name="a", quantity="q", unit="1", at_most=1.0)
    assert (lost["probability_met"], lost["failed"], lost["median"], lost["margin"]) == (0.0, 5, None, None)
    never = risk_files.requirement_check(np.full((10, 4), 2.0), name="a", quantity="q", unit="1", at_most=1.0)
    assert (never["probability_met"], never["posterior_sd"], never["simulation_low"]) == (0.0, 0.0, 0.0)


def test_requirement_wants_one_limit():
    with pytest.raises(InputError, match="exactly one"):
        risk_files.requirement_check(np.ones(3), name="a", quantity="q", unit="1")


@pytest.fixture
def requirement(final):
    rate = final["cdt-3-12"]["sea_level_descent_rate"]
    return risk_files.requirement_check(
        rate - 0.5, name="r", quantity="sea_level_descent_rate", unit="m/s", at_most=9.6, run="cdt-3-12",
        statistic="mean", widened_by=1.2,
    )  # fmt: skip


@pytest.fixture
def written(tmp_path, draws, final, requirement):
    mean = {"sea_level_descent_rate": final["cdt-3-12"]["sea_level_descent_rate"] - 0.5}
    flights = {"cdt-3-12": {"final": final["cdt-3-12"], "mean": mean}}
    widened = {"cdt-3-12": {"sea_level_descent_rate": 1.2}}
    risk_files.write_risk(tmp_path, draws, flights, UNITS, requirements=[requirement], widened=widened)
    return tmp_path


def test_all_files_are_written(written):
    assert {path.name for path in written.iterdir()} == {
        "draws.parquet",
        "draws.csv",
        "draws_units.csv",
        "marginals.csv",
        "correlation.csv",
        "end_of_record.parquet",
        "exceedance.csv",
        "tolerance.csv",
        "requirements.json",
        "data_dictionary.csv",
    }
    back = pd.read_csv(written / "exceedance.csv")
    assert set(zip(back.quantity, back.statistic, strict=True)) == {
        ("descent_rate", "final"), ("sea_level_descent_rate", "final"), ("sea_level_descent_rate", "mean")
    }  # fmt: skip
    assert pd.read_parquet(written / "end_of_record.parquet").attrs["units"]["sea_level_descent_rate"] == "m/s"
    square = pd.read_csv(written / "correlation.csv", index_col="parameter")
    assert list(square.columns) == list(square.index) == list(UNITS)


def test_a_limit_is_a_threshold_of_the_statistic_it_is_set_on(written, requirement):
    """P(exceeded) and P(met) of a requirement add up to one, and other statistics know nothing of its limit."""
    table = pd.read_csv(written / "exceedance.csv")
    there = table[table.threshold == 9.6]
    assert list(zip(there.quantity, there.statistic, strict=True)) == [("sea_level_descent_rate", "mean")]
    assert there.probability.iloc[0] == pytest.approx(1.0 - requirement["probability_met"])


def test_the_tables_tell_which_draws_were_widened(written):
    for name in ("exceedance", "tolerance"):
        factors = pd.read_csv(written / f"{name}.csv").groupby("quantity").widened_by.unique()
        assert list(factors["sea_level_descent_rate"]) == [1.2] and list(factors["descent_rate"]) == [1.0]
    assert json.loads((written / "requirements.json").read_text())[0]["widened_by"] == 1.2


def test_the_dictionary_has_every_column_of_every_file(written):
    table = pd.read_csv(written / "data_dictionary.csv", dtype=str)
    assert list(table.columns) == ["file", "column", "unit", "meaning"] and table.notna().all(axis=None)
    told = {file: list(part.column) for file, part in table.groupby("file")}
    there = {}
    for path in written.iterdir():
        if path.suffix == ".csv" and path.stem != "data_dictionary":
            there[path.name] = list(pd.read_csv(path).columns)
        elif path.suffix == ".parquet":
            there[path.name] = list(pd.read_parquet(path).columns)
    there["requirements.json"] = list(json.loads((written / "requirements.json").read_text())[0])
    assert told == there
    unit = table.set_index(["file", "column"]).unit
    assert unit["draws.csv", "riser_stiffness"] == "N/m" and unit["correlation.csv", "riser_stiffness"] == "1"
    assert unit["end_of_record.parquet", "descent_rate"] == "m/s"


def test_without_flights_only_the_parameter_files(tmp_path, draws):
    assert set(risk_files.write_risk(tmp_path, draws)) == {"draws", "marginals", "correlation"}


def test_runs_with_different_quantities(final):
    both = final | {"sonde": {"descent_rate": np.linspace(10, 12, 50)}}
    table = risk_files.samples_table(both)
    assert list(table.run.unique()) == ["cdt-3-12", "sonde"]
    pairs = set(zip(*risk_files.exceedance_table(table, "final")[["run", "quantity"]].values.T, strict=True))
    assert ("sonde", "descent_rate") in pairs
    assert ("sonde", "sea_level_descent_rate") not in pairs
