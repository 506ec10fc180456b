from __future__ import annotations

from dataclasses import replace

import pytest

from bayeschute.report import sentences
from bayeschute.report.tables import identifiability_tables, record_tables, summary_tables, trust_tables
from bayeschute.report.wording import MISSING


def column(table, label):
    place = [c.label for c in table.columns].index(label)
    return [row[place] for row in table.rows]


def shape_is_right(table):
    return all(len(row) == len(table.columns) for row in table.rows) and (
        not table.groups or sum(span for _, span in table.groups) == len(table.columns)
    )


@pytest.mark.parametrize(
    "make",
    [
        record_tables.flight_table,
        record_tables.repair_table,
        record_tables.preparation_table,
        summary_tables.noise_table,
        summary_tables.posterior_table,
        trust_tables.check_table,
        identifiability_tables.identifiability_table,
        identifiability_tables.direction_table,
        trust_tables.requirement_table,
        trust_tables.tolerance_report,
        trust_tables.marginal_report,
        trust_tables.sampling_table,
    ],
)
def test_every_table_is_a_rectangle(results, make):
    table = make(results)
    assert table is not None and table.rows
    assert shape_is_right(table)
    empty = replace(results, summary={}, structure={}, identifiability={}, flights={}, risk={})
    assert make(empty) is None


def test_noise_shows_what_each_law_has(results):
    table = summary_tables.noise_table(results)
    labels = ["Channel", "White", "Correlated", "Time constant [s]", "Frequency [Hz]", "Damping ratio", "Unit"]
    assert [c.label for c in table.columns] == labels
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}
    assert len(rows) == 4
    assert rows["wind, horizontal"] == [MISSING, "0.610", "5.20", MISSING, MISSING, "m/s"]
    assert rows["breathing"] == [MISSING, "0.0210", MISSING, "0.230", "0.0600", ""]
    drifts = {name: facts for name, facts in results.summary["noise"].items() if name != "breathing"}
    without = summary_tables.noise_table(replace(results, summary={"noise": drifts}))
    assert [c.label for c in without.columns] == [*labels[:4], "Unit"] and shape_is_right(without)


def test_output_error_stands_at_the_precision_of_its_corrected_errors(results):
    rows = [
        {"parameter": "axial[1]", "estimate": 0.91234, "raw_sd": 0.0021, "corrected_sd": 0.0093, "unit": "1"},
        {"parameter": "riser_length", "estimate": 71.3, "raw_sd": 0.05, "corrected_sd": 0.08, "unit": "m"},
        {"parameter": "riser_damping", "estimate": None, "raw_sd": None, "corrected_sd": None, "unit": "N s/m"},
    ]
    table = summary_tables.output_error_table(replace(results, summary={"output_error": rows}))
    assert shape_is_right(table) and [row[0].text for row in table.rows] == [row["parameter"] for row in rows]
    assert [cell.text for cell in table.rows[0][1:]] == ["0.9123", "0.0021", "0.0093", ""]
    assert [cell.text for cell in table.rows[1][1:]] == ["71.300", "0.050", "0.080", "m"]
    assert [cell.text for cell in table.rows[2][1:4]] == [MISSING] * 3
    assert summary_tables.output_error_table(results) is None


def test_ranking_is_the_print_out_of_the_report(results):
    facts = results.structure["coefficients"]["axial"]
    table = summary_tables.ranking_table(facts)
    assert [c.label for c in table.columns] == "o.f.,# index,term,sqrt(mse),dmse,perr,R2,pe,n,F".split(",")
    assert column(table, "sqrt(mse)")[0].text == "1.503e-01"
    assert column(table, "dmse")[0].text == "-6.950e-01"
    assert table.marked == {facts["pse_minimum_at"] - 1}
    assert shape_is_right(table)


def test_the_ceiling_in_use_stands_out(results):
    table = summary_tables.ceiling_table(results.structure["coefficients"]["transverse"])
    assert table.marked == {2}
    assert [cell.text for cell in column(table, "Terms")] == ["7", "5", "4", "3"]


def test_posterior_says_where_truth_and_record_stand(results):
    table = summary_tables.posterior_table(results)
    verdicts = {row[0].text: row[-1] for row in table.rows}
    assert verdicts["transverse[repulsion(0.8)]"].kind == "outside"
    assert verdicts["axial[1]"].small == "inside"
    weak = {row[0].text: row[6].kind for row in table.rows}
    assert weak["riser_stiffness"] == "weak" and weak["axial[1]"] == ""
    assert column(table, "mean")[0].text.startswith("0.9")


def test_faults_that_are_alike_become_one_row(results):
    table = record_tables.repair_table(results)
    assert len(table.rows) == 4
    together = [cell.text for cell in table.rows[-1]]
    assert together[1:6] == ["gap, 8 times", "canopy_position.2", "5.0", "40.8", "36"]
    assert "longest: 0.8 s at 40.0 s" in together[6]
    prepared = record_tables.preparation_table(results)
    assert [row[1].text for row in prepared.rows] == ["resampled"]


def test_too_many_repairs_are_counted_not_hidden(results):
    flights = {"x": {"repairs": [{"kind": "gap", "variable": f"canopy_position.{i}"} for i in range(75)]}}
    table = record_tables.repair_table(replace(results, summary={"flights": flights}, flights={}))
    assert len(table.rows) == 60 and "15 more" in table.caption


def test_the_requirement_keeps_two_doubts_apart(results):
    row = trust_tables.requirement_table(results).rows[0]
    requirement = results.summary["requirements"][0]
    assert row[3].text == f"{requirement['probability_met']:.2f}"
    assert row[4].text == f"{requirement['simulation_low']:.2f} … {requirement['simulation_high']:.2f}"
    assert row[5].text == "–"


def test_a_check_that_did_not_run_is_no_pass(results):
    table = trust_tables.check_table(results)
    assert [cell.text for cell in column(table, "Result")] == ["passed"] * 6 + ["not judged"]
    assert [cell.text for cell in column(table, "Wanted")][:2] == ["at most 1.01", "at least 400"]


def test_key_sentences_are_made_of_the_numbers(results):
    risk, prediction, trust = sentences.key_sentences(results)
    assert "at most 10.1 m/s (33.0 ft/s)" in risk and "400 simulated flights" in risk
    assert prediction == (
        "On cdt-3-12, which was not fitted, the 90 % band contains 91 % of the true swing angle and 87 % of the true "
        "descent rate."
    )
    assert trust.startswith("All 6 checks passed; the 90 % intervals of 8 of 9 parameters")


def test_key_sentences_of_many_flights_and_no_requirement(results):
    flights = {f"d{i}": {"roles": ["identify", "predict"]} for i in range(3)}
    coverage = {f"d{i}": {"descent_rate": {"truth": None, "record": 0.8 + 0.05 * i}} for i in range(3)}
    summary = {"flights": flights, "coverage": coverage, "checks": {"a": {"passed": True}}, "label": "not checked: x"}
    many = replace(results, summary=summary)
    risk, prediction, trust = sentences.key_sentences(many)
    assert (
        prediction == "Over 3 flights the 90 % bands contain 80 % to 90 % of the recorded descent rate (median 85 %)."
    )
    assert risk.startswith("At the end of cdt-3-11 the descent rate lies between")
    assert trust == "The one check passed."
    assert "No requirement" in sentences.risk_sentence(replace(many, predictions={}))


def test_the_least_likely_requirement_is_named(results):
    base = results.summary["requirements"][0]
    both = [base, base | {"name": "swing", "probability_met": 0.2}]
    assert "“swing”" in sentences.risk_sentence(replace(results, summary={"requirements": both}))


def test_r_hat_is_marked_by_the_bound_of_the_run_s_check(results):
    checks = results.summary["checks"]
    for bound, marked in ((1.01, False), (1.0, True)):
        summary = results.summary | {"checks": checks | {"rhat": {"passed": not marked, "value": 1.0, "bound": bound}}}
        table = summary_tables.posterior_table(replace(results, summary=summary))
        assert {cell.kind == "bad" for cell in column(table, "R-hat")} == {marked}


def test_no_family_is_said_to_have_the_least_criterion_that_need_not_have_it(results):
    table = trust_tables.marginal_report(results)
    assert "within 2 of the smallest" in table.caption and "with the smallest" not in table.caption


def test_parameters_have_both_systems_of_units(results):
    table = summary_tables.posterior_table(results)
    assert table is not None
    rows = {row[0].text: row for row in table.rows}
    length, stiffness = rows["riser_length"], rows["riser_stiffness"]
    assert float(length[3].small) == pytest.approx(float(length[3].text) / 0.3048, abs=0.02)
    low, high = length[5].small.split(" … ")
    assert low != high  # as many decimals as the standard deviation has in that unit
    assert "[m, small print ft]" in length[0].small and "[kN/m, small print lbf/ft]" in stiffness[0].small
    assert rows["axial[1]"][3].small == ""


def test_quantiles_of_marginals_and_truths_have_both_systems_of_units(results):
    table = trust_tables.marginal_report(results)
    rows = {row[0].text: row for row in table.rows}
    length, drag = rows["riser_length"], rows["axial[1]"]
    assert (length[1].text, length[1].small) == ("m", "ft") and drag[1].small == ""
    for si in length[5:10]:
        assert float(si.small) == pytest.approx(float(si.text) / 0.3048, rel=1e-3)
    assert [cell.small for cell in (*length[3:5], *drag[5:10])] == [""] * 7  # constants of a family are not of its unit
    truths = {row[0].text: row[-1] for row in summary_tables.posterior_table(results).rows}
    shown = truths["riser_length"]
    us, place = shown.small.split(", ")
    assert float(us) == pytest.approx(float(shown.text) / 0.3048, abs=0.05) and place in ("inside", "outside")


def test_fitted_terms_stand_with_their_evidence_the_core_first():
    scores = {"transverse[e*alpha^4]": 0.5, "axial[alpha^4]": 12.0, "transverse[c]": -3.2}
    found = {"terms": ["axial[1]", "axial[alpha^4]", "transverse[e]"], "how": "search", "log_bayes_factors": scores}
    table = summary_tables.fitted_terms_table(found)
    rows = [[cell.text for cell in row] for row in table.rows]
    assert [row[0] for row in rows] == [
        "axial[1]",
        "transverse[e]",
        "axial[alpha^4]",
        "transverse[e*alpha^4]",
        "transverse[c]",
    ]
    assert [row[2] for row in rows] == ["fitted", "fitted", "fitted", "left out", "left out"]
    assert [row[3] for row in rows] == ["–", "–", "+12.0", "+0.5", "-3.2"]
    assert "axial force" in rows[0][1]


def test_fitted_terms_without_a_search_are_a_list():
    table = summary_tables.fitted_terms_table({"terms": ["axial[1]"], "how": "pool"})
    assert [column.label for column in table.columns] == ["Term", "Meaning"] and len(table.rows[0]) == 2
    assert summary_tables.fitted_terms_table({"terms": []}) is None
