"""The page of results says what the results say, and what is off."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from calibration_page import diagnosis, on_the_clock, overview, page, whole

from bayeschute.calibration.scores import LEVELS

ROOT = Path(__file__).parents[2]


def result(share=0.9, band=0.88, disturbance="none", replicates=100):
    levels = dict.fromkeys(map(str, LEVELS), share)
    parameter = {"share": share, "standard_error": 0.03, "replicates": replicates, "coverage": levels, "left_out": 2,
                 "mean_z": 0.1, "rms_z": 1.1}  # fmt: skip
    swing = {"share": band, "standard_error": 0.02, "replicates": replicates, "role": "predict", "coverage": levels,
             "width": 0.12, "interval_score": 0.2, "crps": 0.03, "pit": [0.5] * 10, "by_time": {"0-30 s": 0.87}}  # fmt: skip
    return {
        "study": "cdt", "noise": "latent", "disturbance": disturbance, "says": "as it is", "replicates": replicates,
        "failed": {"7": "lost"}, "seeds": [1, 101], "missed_checks": {"rhat": 3},
        "coverage": {"axial[1]": share, "new/swing_angle": band},
        "standard_error": {"axial[1]": 0.03, "new/swing_angle": 0.02},
        "parameters": {"axial[1]": parameter}, "bands": {"new/swing_angle": swing},
        "commit": "0123456789abcdef", "date": "2026-11-30", "versions": {"bayeschute": "0.1.0"},
    }  # fmt: skip


def test_the_overview_has_a_row_a_result_and_marks_what_is_surely_off():
    made = overview([result(), result(band=0.70, disturbance="mass")])
    assert len(made) == 2 + 2 + 1
    assert "| `latent`, none | 100 | 1 | 90 (90 to 90) | 88 ± 2 | `0123456`, 2026-11-30 |" in made
    assert "**70 ± 2**" in made[3]


def test_the_overview_says_what_code_flew_the_replicates():
    early = {name: value for name, value in result().items() if name not in ("commit", "date")}
    one, other = overview([result(), early])[2:4]
    assert one.endswith("| `0123456`, 2026-11-30 |") and other.endswith("| version 0.1.0 |")


def test_a_term_that_few_replicates_select_counts_by_its_intervals_and_is_no_least_or_most():
    one = result()
    rare = one["parameters"]["axial[1]"] | {"share": 0.0, "replicates": 2}
    one["parameters"] |= {"axial[closing]": rare}
    one["coverage"] |= {"axial[closing]": 0.0}
    one["standard_error"] |= {"axial[closing]": 0.3}
    assert "| 88 (90 to 90) |" in overview([one])[2]


def test_diagnosis_names_quantity_configuration_and_significance():
    assert diagnosis([result()]) == ["Nothing that is promised lies outside 85 to 95 %."]
    made = diagnosis([result(share=0.83, disturbance="mass"), result(band=0.99)])
    assert made == [
        "- `latent`, mass, too narrow (probably): `axial[1]` 83 ± 3 %.",
        "- `latent`, none, too wide (beyond doubt): `new/swing_angle` 99 ± 2 %.",
    ]


def test_diagnosis_says_once_what_several_quantities_share():
    (made,) = diagnosis([result(share=0.3, band=0.4)])
    assert made.startswith("- `latent`, none, too narrow (beyond doubt): `axial[1]` 30 ±")
    assert ", `new/swing_angle` 40 ±" in made


def test_what_chance_may_do_is_counted_and_not_named():
    made = diagnosis([result(band=0.96) | {"replicates": 3}])
    assert made == ["- 1 more lie outside 85 to 95 %, by no more than chance may do with as few replicates."]


def test_one_configuration_in_full():
    text = "\n".join(whole(result(share=0.8)))
    assert "100 replicates, 1 failed (seeds 1 to 101); checks of single runs that were missed: `rhat` 3 times." in text
    assert "3.0 **narrow**" in text and "+0.10, 1.10" in text and "0-30 s: 87" in text


def test_corrections_are_told_where_replicates_tell_them():
    text = "\n".join(whole(result() | {"pareto_k": {"replicates": 20, "below": 19}}))
    assert "Pareto k of the sampler's correction was below 0.7 in 19 of 20." in text
    assert "Pareto k" not in "\n".join(whole(result()))


def test_modes_are_told_where_a_result_has_them():
    mode = {"share": 0.87, "standard_error": 0.03, "replicates": 40, "role": "predict", "mean_z": 0.2, "rms_z": 1.05,
            "coverage": dict.fromkeys(map(str, LEVELS), 0.87), "pit": 0.46}  # fmt: skip
    made = result() | {"modes": {"new/pendulum amplitude": mode}}
    cells = "| new/pendulum amplitude | 40 | 87 | 87 | 87 | 87 | 87 | 3.0 | +0.20, 1.05 | 0.46 |"
    assert cells in "\n".join(whole(made))
    assert "By mode" not in "\n".join(whole(result()))


def test_the_time_is_told_where_every_part_tells_it():
    parts = [result() | {"clock": {"minutes": m, "workers": 2}} for m in (40.0, 80.0)]
    said = "All of it took 2.0 hours on the clock with 2 processes, 80 minutes of it for the longest part."
    assert on_the_clock(parts) == [said, ""]
    assert said in page(parts, [], "make it")
    assert on_the_clock([*parts, result()]) == []
    assert on_the_clock([*parts, result() | {"clock": {"minutes": 1.0, "workers": None}}]) == []


def test_the_page_tells_ranks_too():
    ranks = {"study": "dumbbell", "replicates": 300, "failed": 0, "passed": True,
             "quantities": {"C_A0": {"passed": True}, "swing": {"passed": True}},
             "spoiled": {"shift": 0.3, "passed": False, "quantities": {"C_A0": {"passed": False}}}}  # fmt: skip
    text = page([result()], [ranks], "make calibration")
    assert "`make calibration`" in text
    assert "| dumbbell | as it is | 300 | 0 | 2 | all inside |" in text
    assert "| dumbbell | its draws moved by 0.3 sd | 300 | 0 | 1 | outside: C_A0 |" in text
    assert "## Configurations" in text and text.endswith("\n")


def test_the_shipped_page_is_that_of_the_shipped_results():
    shipped, stored = ROOT / "docs/calibration.md", ROOT / "models/reference/calibration"
    if not shipped.exists():
        pytest.skip("no calibration is shipped")
    text = shipped.read_text(encoding="utf-8")
    for file in sorted(stored.glob("*.json")):
        made = json.loads(file.read_text(encoding="utf-8"))
        if "coverage" in made:
            assert "\n".join(whole(made)) in text, file.name
