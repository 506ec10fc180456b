"""`[[knowledge]]`: read in SI from points, files and published sets, and refused with where, got and wanted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.study.schema.knowledge.written import COEFFICIENT, CURVE, with_text

from bayeschute.study.archive import study_from_plain, study_to_plain
from bayeschute.study.load import check_study, load_study
from bayeschute.study.stage_keys import stage_keys
from bayeschute.study.study import canonical, study_hash


def test_points_are_in_si_and_in_order(cluster: Path):
    study = load_study(with_text(cluster, COEFFICIENT + CURVE))
    assert check_study(cluster) == []
    first, second = study.knowledge
    assert (first.mean, first.sd, first.use) == (0.85, 0.05, "prior") and second.use == "compare"
    np.testing.assert_allclose(second.samples, [[np.deg2rad(10), -0.01, 0.01], [np.deg2rad(20), 0.03, 0.01]])


def test_a_file_says_the_same_as_points(cluster: Path):
    (cluster.parent / "tunnel.csv").write_text("a,c,s\n20,0.03,0.01\n10,-0.01,0.01\n", encoding="utf-8")
    columns = """file = "tunnel.csv"
columns = { at = { column = "a", unit = "deg" }, value = { column = "c", unit = "1" }, sd = { column = "s", unit = "1" } }"""
    rows = 'points = [["20 deg", 0.03, 0.01], ["10 deg", -0.01, 0.01]]'
    by_points = load_study(with_text(cluster, CURVE))
    cluster.write_text(cluster.read_text(encoding="utf-8").replace(rows, columns), encoding="utf-8")
    by_file = load_study(cluster)
    np.testing.assert_allclose(by_file.knowledge[0].samples, by_points.knowledge[0].samples, rtol=1e-12)
    (cluster.parent / "tunnel.csv").unlink()
    (fault,) = check_study(cluster)
    assert "knowledge" in fault.where and "no such file" in fault.got


def test_what_is_not_said_changes_no_hash_and_what_is_only_compared_no_fit(cluster: Path):
    before = load_study(cluster)
    assert "knowledge" not in canonical(before)
    plain = stage_keys(before, False, {})
    compared = stage_keys(load_study(with_text(cluster, CURVE)), False, {})
    told = stage_keys(load_study(with_text(cluster, COEFFICIENT)), False, {})
    assert compared["fit"] == plain["fit"] and compared["report"] != plain["report"]
    assert told["priors"] != plain["priors"] and told["fit"] != plain["fit"] and told["structure"] == plain["structure"]


def test_a_stored_study_comes_back_with_what_others_know(cluster: Path):
    study = load_study(with_text(cluster, COEFFICIENT + CURVE))
    plain = json.loads(json.dumps(study_to_plain(study)))
    assert study_hash(study_from_plain(plain)) == study_hash(study)
    del plain["knowledge"]  # as a program stored it that knew of none
    assert study_from_plain(plain).knowledge == ()


FAULTS = [
    (COEFFICIENT, "mean = 0.85\n", "", "knowledge", "mean and sd"),
    (COEFFICIENT, "sd = 0.05", "sd = 0.0", "sd", "> 0"),
    (COEFFICIENT, "axial[1]", "axial[q]", "target", "a coefficient of a candidate"),
    (COEFFICIENT, "axial[1]", "riser_stiffness", "target", "a coefficient of a candidate"),
    (COEFFICIENT, '"prior"', '"posterior"', "use", "'prior', 'compare'"),
    (COEFFICIENT, "mean = 0.85", 'mean = "0.85"', "mean", "a number"),
    (COEFFICIENT, "mean = 0.85", "mean = 0.85\ncommon_sd = 0.1", "knowledge", "nothing of a curve"),
    (COEFFICIENT, "mean = 0.85", "mean = 0.85\npoints = []", "points", "a list of points"),
    (CURVE, '"C_N"', '"C_m"', "knowledge", "one of C_A, C_N, C_N_rate, proximity"),
    (CURVE, '"10 deg", -0.01', "10, -0.01", "knowledge", "such as '10 deg'"),
    (CURVE, '"10 deg", -0.01', '"100 deg", -0.01', "knowledge", "<= 1.5708 rad"),
    (CURVE, '"10 deg", -0.01', '"20 deg", -0.01', "knowledge", "each angle or distance once"),
    (CURVE, '"10 deg", -0.01, 0.01', '"10 deg", -0.01', "knowledge", "rows of 3"),
    (CURVE, '"10 deg", -0.01, 0.01', '"10 deg", -0.01, 0.0', "knowledge", "standard deviations > 0"),
    (CURVE, "common_sd = 0.005", 'file = "x.csv"', "knowledge", "exactly one of points, file and published"),
    (CURVE, "common_sd = 0.005", "common_sd = -1", "common_sd", ">= 0"),
    (CURVE, "common_sd = 0.005", "samples = [[0.1, 1.0, 1.0]]", "samples", "points or a file"),
    (CURVE, "points = [", "points = 3 #", "points", "a list of points"),
]


@pytest.mark.parametrize(("table", "old", "new", "where", "wanted"), FAULTS)
def test_faults_say_where_and_what_was_wanted(cluster: Path, table, old, new, where, wanted):
    assert old in table
    faults = check_study(with_text(cluster, table.replace(old, new, 1)))
    assert any(where in f.where and wanted in f"{f.wanted} {f.do}" for f in faults), list(map(str, faults))
