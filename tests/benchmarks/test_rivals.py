"""benchmarks/rivals.py without the rivals: lines, scores, how a script that fails is told, and the page."""

from __future__ import annotations

import copy
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import rivals
import rivals_page
import rivals_scores
from rivals_records import CASES, Truth, make

TRUTH = Truth({"a": 2.0, "log_b": -1.0}, np.arange(50.0), {"descent_rate": np.full(50, 10.0)})


def test_lines_leave_out_blanks_comments_and_docstrings():
    source = '"""A docstring\n\nof three lines."""\n\nimport os  # said\n# not\n\n\ndef f(x):\n    """Says."""\n    return (\n        x,\n        """not a docstring,\n        counted""",\n    )\n'
    assert rivals_scores.lines(source) == 7
    assert rivals_scores.lines("x = 1\n\n# y = 2\n") == 1


@pytest.mark.parametrize("script", sorted(rivals.SCRIPTS.glob("*_*.py")), ids=lambda p: p.stem)
def test_every_script_is_asked_by_a_program_and_reads_what_all_read(script):
    asked = {rivals.script_of(p, case).name for p in rivals.PROGRAMS for case in CASES if not rivals.unable(p, case)}
    assert script.name in asked
    text = script.read_text(encoding="utf-8")
    assert "exchange.read()" in text and "exchange.write(" in text and 5 < rivals_scores.lines(text) < 130


def test_every_program_has_a_script_or_a_reason():
    for program in rivals.PROGRAMS:
        for case in CASES:
            assert rivals.unable(program, case) or rivals.script_of(program, case).is_file(), (program, case)


def test_parameters_of_known_draws():
    rng = np.random.default_rng(1)
    chains = np.stack([rng.normal(2.2, 0.05, (4, 500)), rng.normal(-1.0, 0.1, (4, 500))], axis=2)
    found = rivals_scores.parameter_scores(["a", "log_b"], chains, TRUTH.parameters)
    assert found["a"]["error"] == pytest.approx(0.1, abs=0.005) and not found["a"]["held"]
    assert found["log_b"]["error"] == pytest.approx(0.0, abs=0.02) and found["log_b"]["held"]
    assert rivals_scores.split_rhat(chains) < 1.02
    assert rivals_scores.split_rhat(chains + np.arange(4.0)[:, None, None]) > 2.0
    assert rivals_scores.parameter_scores(["a"], np.zeros((0, 0, 1)), TRUTH.parameters) == {}


def test_a_band_of_the_right_law_holds_ninety_percent():
    rng = np.random.default_rng(2)
    time, truth = np.arange(4000.0), rng.normal(0.0, 1.0, 4000)
    band = rivals_scores.band_scores(time, rng.normal(0.0, 1.0, (400, 4000)), truth)
    assert band["held"] == pytest.approx(0.9, abs=0.02) and band["width"] == pytest.approx(3.29, abs=0.05)
    narrow = rivals_scores.band_scores(time, np.zeros((400, 4000)), truth)
    noisy = rivals_scores.band_scores(time, np.zeros((400, 4000)), truth, np.ones(400))
    assert narrow["held"] == 0.0 and narrow["wis"] > noisy["wis"] and noisy["held"] == pytest.approx(0.9, abs=0.02)
    lost = np.full((10, 4000), np.nan)
    assert rivals_scores.band_scores(time, lost, truth) == {"failed_draws": 10}


def answer(folder, chains, motion, noise):
    np.savez(folder / "answer.npz", chains=chains, **{"motion.descent_rate": motion, "noise.descent_rate": noise})
    told = {"names": ["a", "log_b"], "note": "", "processor_s": 3.0, "versions": {}}
    return rivals.scored(told, TRUTH, folder)


def test_means_over_records_count_what_failed(tmp_path):
    rng = np.random.default_rng(3)
    chains = rng.normal((2.0, -1.0), 0.1, (4, 200, 2))
    one = answer(tmp_path, chains, rng.normal(10.0, 0.1, (100, 50)), np.full(100, 0.1))
    made = rivals.summary([one, {"failed": "NoFitError: no mode"}])
    assert (made["records"], made["failed"], made["intervals"], made["intervals_held"]) == (2, 1, 2, 2)
    assert made["processor_s"] == 3.0 and made["descent_rate"]["held"] == 1.0
    assert made["descent_rate.with_noise"]["width"] > made["descent_rate"]["width"]
    assert rivals.summary([{"failed": "x"}])["error"] is None


def test_a_script_that_fails_is_told_without_places(tmp_path):
    one = rivals.ask(rivals.Program("emcee", "emcee"), "descent-calm", tmp_path, sys.executable, 1.0)
    assert "FileNotFoundError" in one["failed"] and str(tmp_path) not in one["failed"]
    said = rivals.plain(f"bayeschute.posterior.NoFitError: in {tmp_path}/problem.json", tmp_path)
    assert said == "NoFitError: in problem.json"


@pytest.mark.slow
def test_a_swing_in_still_air_has_an_answer_that_holds(tmp_path):
    """The record hardly tells three coefficients apart: under the noise that it shows its posterior is a curved valley."""
    ours, limit = next(p for p in rivals.PROGRAMS if p.script == "bayeschute"), 30.0
    truth = make("swing-calm", 4, tmp_path)
    one = rivals.scored(rivals.ask(ours, "swing-calm", tmp_path, sys.executable, limit), truth, tmp_path)
    assert one["rhat"] < 1.02 and sum(p["held"] for p in one["parameters"].values()) >= 4
    assert all(0.02 < p["sd"] / abs(p["truth"]) < 0.3 for p in one["parameters"].values())
    assert all(band["held"] > 0.8 for band in one["bands"].values())


@pytest.mark.parametrize("case", ["descent-calm", "descent-gusts", "swing-calm", "swing-gusts"])
def test_records_are_of_the_seed_alone_and_gusts_are_not_in_the_calm(case, tmp_path):
    truth, again = (make(case, 1, tmp_path / name) for name in ("one", "two"))
    files = [sorted((tmp_path / name).iterdir()) for name in ("one", "two")]
    assert [p.read_bytes() for p in files[0]] == [p.read_bytes() for p in files[1]]
    np.testing.assert_array_equal(truth.motion["descent_rate"], again.motion["descent_rate"])
    problem = json.loads((tmp_path / "one/problem.json").read_text(encoding="utf-8"))
    assert set(problem["priors"]) == set(truth.parameters)
    for name, (centre, sd) in problem["priors"].items():
        assert abs(truth.parameters[name] - centre) < 4.0 * sd


def test_the_shipped_page_is_that_of_the_stored_files():
    assert rivals_page.PAGE.read_text(encoding="utf-8") == rivals_page.page(rivals_page.stored()), (
        "python benchmarks/rivals_page.py writes it anew"
    )


def test_a_stored_number_that_is_changed_changes_the_page():
    kept = rivals_page.stored()
    before = rivals_page.page(kept)
    assert kept
    for index, one in enumerate(kept):
        for name, program in one["programs"].items():
            for key, value in program["summary"].items():
                if value is None or key in ("intervals_held", "records", "failed"):
                    continue
                changed = copy.deepcopy(kept)
                summary = changed[index]["programs"][name]["summary"]
                summary[key] = {k: 1.7 * v + 0.1 for k, v in value.items()} if isinstance(value, dict) else 3 * value
                assert value == 0 or rivals_page.page(changed) != before, (one["case"], name, key)


def test_stored_summaries_are_those_of_their_records_and_lines_those_of_their_scripts():
    for one in rivals_page.stored():
        for program in one["programs"].values():
            rows = [{**a, "rhat": np.nan if a.get("rhat") is None else a["rhat"]} for a in program["seeds"].values()]
            assert rivals.no_nan(rivals.summary(rows)) == program["summary"]
            script = (rivals.SCRIPTS / program["script"]).read_text(encoding="utf-8")
            assert rivals_scores.lines(script) == program["lines"]


def test_every_stored_result_tells_what_made_it_and_names_no_place():
    for one in rivals_page.stored():
        told = one["provenance"]
        assert all(told[key] for key in ("commit", "command", "date", "machine", "versions", "numerics"))
        assert f"--cases {one['case']}" in told["command"]
        assert not re.search(r'"/\w|/tmp/|/work/|https?:|File "', json.dumps(one))


def test_a_rival_that_is_better_is_said_to_be():
    row = {"records": 2, "failed": 0, "worst_rhat": 1.01, "intervals": 10, "intervals_held": 9, "error": 0.1}
    programs = {
        "bayeschute": {"lines": 30, "summary": row | {"processor_s": 20.0}, "seeds": {}},
        "fast": {"lines": 40, "summary": row | {"processor_s": 2.0, "error": 0.2}, "seeds": {}},
        "not converged": {"lines": 5, "summary": row | {"processor_s": 1.0, "worst_rhat": 1.5}, "seeds": {}},
    }
    found = {w: (who, other) for w, who, other in rivals_page.winners({"case": "x", "programs": programs})}
    assert found["processor time"] == ("fast", True) and found["error of the parameters"] == ("bayeschute", False)
    assert found["lines to write"] == ("bayeschute", False)


def test_an_answer_where_ours_failed_is_told_and_so_are_better_numbers_of_draws_that_have_not_converged():
    lost = {"records": 2, "failed": 1, "worst_rhat": 1.0, "intervals": 5, "intervals_held": 4, "error": 0.2}
    wild = {"records": 2, "failed": 0, "worst_rhat": 3.0, "intervals": 10, "intervals_held": 2, "error": 0.1}
    programs = {"bayeschute": {"summary": lost}, "wild": {"summary": wild}}
    assert list(rivals_page.ahead({"programs": programs})) == [
        ("an answer at all, where bayeschute failed on 1 of 2", "wild"), ("error of the parameters", "wild"),
    ]  # fmt: skip


def test_the_page_is_linked():
    root = Path(__file__).parents[2]
    assert "rivals.md" in (root / "mkdocs.yml").read_text(encoding="utf-8")
    assert "(rivals.md)" in (root / "docs/evidence.md").read_text(encoding="utf-8")
