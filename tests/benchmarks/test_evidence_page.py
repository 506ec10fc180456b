"""Results on flights of another program: each is stored with what made it, and the page says what is stored."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from types import SimpleNamespace

import evidence_page
import numpy as np
import other_stored
import pytest

ROOT = Path(__file__).parents[2]
FIT = {"processor_s": 12.0, "wall_s": 13.0, "converged": True, "reason": "", "label": "", "failed": ["rhat"]}


@pytest.fixture(scope="module")
def made():
    return SimpleNamespace(page=evidence_page, stored=other_stored)


def _numbers(tree, path=()):
    """Where numbers of a stored file are that the page tells."""
    told = {"held", "width_over_replicates", "wis_over_climatology", "processor_s", "share_found"}
    for key, value in tree.items():
        if isinstance(value, dict) and key not in ("climatology", "residuals"):
            yield from _numbers(value, (*path, key))
        elif key in told and value is not None:
            yield (*path, key)


def _stored(made):
    page = made.page
    return [page.stored(place) for place in (page.STORED, page.INDEPENDENT, page.STARTS, page.MEASURED)]


def test_the_shipped_page_is_that_of_the_stored_files(made):
    assert made.page.PAGE.read_text(encoding="utf-8") == made.page.page(*_stored(made)), (
        "python benchmarks/evidence_page.py writes it anew"
    )


def test_a_stored_number_that_is_changed_changes_the_page(made):
    kept = _stored(made)
    places = [
        (kind, index, path) for kind in range(4) for index, one in enumerate(kept[kind]) for path in _numbers(one)
    ]
    before = made.page.page(*kept)
    assert {kind for kind, _, _ in places} == {0, 1, 2, 3}
    for kind, index, path in places:
        changed = copy.deepcopy(kept)
        at = changed[kind][index]
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] *= 1.5
        assert made.page.page(*changed) != before, path


def test_every_stored_result_tells_what_made_it(made):
    sets, independent, starts, studies = _stored(made)
    results = [(f"--sets {one['set']}", r) for one in sets for r in one.get("windows", {}).values()]
    results += [(f"--sets {one['set']}", one["whole"]) for one in sets if "whole" in one]
    results += [(f"--independent {one['set']}", one["whole"]) for one in independent]
    results += [(f"optimum.py {one['study']}.toml", one) for one in starts]
    for option, result in results + [(f"--studies {one['study']}", one) for one in studies]:
        told = result["provenance"]
        assert all(told[key] for key in ("commit", "command", "date", "machine", "versions", "numerics"))
        assert option in told["command"] and not re.search(r'"/\w', json.dumps(result))


def test_other_numerics_are_said_to_be_older(made):
    now = made.stored.made_now("Q", None)
    assert made.stored.present(now) and now["command"].endswith("--sets Q")
    assert not made.stored.present(now | {"numerics": "0" * 64})
    other = now["versions"] | {"jax": "0.0.1"}
    assert not made.stored.present(now | {"versions": other})
    one = {"set": "Q", "windows": {"45": FIT | {"provenance": now | {"numerics": "0" * 64}}}}
    assert "| older numerics |" in made.page.page([one], [], [], [])


def test_the_farthest_of_all_starts_is_told_and_how_many_did_not_converge(made):
    row = {"converged": True, "away": 0.02, "worse": -0.3}
    rows = [
        row,
        row | {"away": 0.004},
        row | {"away": 7.0},
        row | {"converged": False, "away": np.nan, "worse": np.nan},
    ]
    now = made.stored.made_now("Q", None)
    one = {"study": "Q_1", "starts": 5, "share_found": 0.6, "rows": rows, "provenance": now}
    assert any(line.startswith("| Q_1 | 3 of 5 | 1 | 7 | 0.3 |") for line in made.page.starts_table([one]))


def test_windows_are_stored_beside_whole_flights_each_with_its_own_origin(made, tmp_path):
    folder, kept = tmp_path / "Q", tmp_path / "kept"
    folder.mkdir()

    def hold(results):
        (folder / "results.json").write_text(json.dumps(results), encoding="utf-8")
        return json.loads(made.stored.store("Q", folder, kept).read_text(encoding="utf-8"))

    first, later = {"commit": "a"}, {"commit": "b"}
    assert (
        hold({"whole": FIT | {"residuals": [np.inf, -np.inf, np.nan], "provenance": first}})["whole"]["residuals"]
        == [None] * 3
    )
    hold({"whole": FIT | {"key": "k", "reason": f"no {folder}/Q_1.nc", "provenance": first}})
    held = hold({"Q_1_45s": FIT | {"provenance": later}, "Q_1_90s": FIT | {"quick": True, "provenance": later}})
    assert held == {
        "set": "Q",
        "whole": FIT | {"reason": "no Q_1.nc", "provenance": first},
        "windows": {"45": FIT | {"provenance": later}},
    }


def test_a_set_turned_round_stands_beside_the_set_as_it_is(made, tmp_path):
    folder, kept = tmp_path / "S", tmp_path / "kept"
    folder.mkdir()
    now = made.stored.made_now("S", None, 2)
    assert now["command"].endswith("--sets S --identify 2")
    scores = {"against": "its own record", "true": False, "held": 0.72, "wis_over_climatology": 0.85}
    whole = FIT | {"terms": ["axial[1]"], "flights": {"S_1": dict.fromkeys(made.page.QUANTITIES, scores)}}
    for name, result in (("whole", whole | {"flights": {}}), ("from_2", whole)):
        (folder / "results.json").write_text(json.dumps({name: result | {"provenance": now}}), encoding="utf-8")
        path = made.stored.store("S", folder, kept)
    held = json.loads(path.read_text(encoding="utf-8"))
    assert set(held) == {"set", "whole", "turned"} and held["turned"]["2"]["flights"] == whole["flights"]
    before, _, after = made.page.page([held], [], [], []).partition("## Turned round")
    assert "| S_1 | its own record | 72 |" in after and "| S_2 | yes |" in after and "S_1" not in before
    assert "Turned round" not in made.page.page([held | {"turned": {}}], [], [], [])


def test_a_result_of_unknown_origin_is_refused(made, tmp_path):
    (tmp_path / "results.json").write_text(json.dumps({"whole": FIT}), encoding="utf-8")
    with pytest.raises(SystemExit, match="does not tell what made it"):
        made.stored.store("Q", tmp_path, tmp_path / "kept")


def test_the_prose_has_no_shares_of_its_own():
    """Percentages of README and of the page on evidence stand on a page made from files."""
    made, said = (
        "".join((ROOT / name).read_text(encoding="utf-8") for name in names)
        for names in (("docs/other-flights.md", "docs/calibration.md"), ("README.md", "docs/evidence.md"))
    )
    shares = re.findall(r"\d[\d.,]*(?: ?%| standard (?:errors|deviations)| times| of \d+)", said)
    assert [share for share in shares if share not in made] == []
