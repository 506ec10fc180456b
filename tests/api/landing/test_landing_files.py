"""Files of landings: each holds what the noun says, to the last digit, and the dictionary names every column."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.landing.plans import small_plan

import bayeschute as bc
from bayeschute.api.landing import landing_files as module
from bayeschute.api.landing.landing_files import dictionary, write_csv, write_for_others, write_landings
from bayeschute.api.landing.landings import in_words, requirement_table
from bayeschute.landing.aero_table import aero_table
from bayeschute.landing.decisions.requirements import Limit, Requirement
from bayeschute.landing.measures import IDS, MEASURES, ROW

SOFT = Requirement("soft", (Limit("vertical_speed", 10.0), Limit("hang_angle", 0.5)), 0.5, 0.9)
UPRIGHT = Requirement("upright", (Limit("hang_angle", 0.4),), 0.9, 0.8)


@pytest.fixture(scope="module")
def landings():
    """Numbers at random, two landings of which failed."""
    rng, rows = np.random.default_rng(3), np.zeros(96, ROW)
    for name in MEASURES:
        rows[name] = rng.uniform(0.1, 1.0, 96) * (12.0 if "speed" in name else 1.0)
    for name in IDS:
        rows[name] = np.arange(96) % 12 if name == "draw" else np.arange(96)
    rows["label"] = np.arange(96) % 6
    for name in MEASURES:
        rows[name][:2] = np.nan
    rows["outcome"][:2], rows["label"][:2] = [1, 2], -1
    return bc.Landings("n", rows, (SOFT, UPRIGHT), {"axial[1]": rng.normal(size=12)}, ("rhat",))


@pytest.fixture(scope="module")
def written(landings, tmp_path_factory):
    """The folder, what was said, frames of exceedance, and figures with their places; nothing is drawn here."""
    folder, frames, figures = tmp_path_factory.mktemp("landed"), {}, []
    exceedance = bc.Landings.exceedance
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bc.Landings, "exceedance", lambda self, q: frames.setdefault(q, exceedance(self, q, [0.3, 0.7])))
        patch.setattr(bc.Landings, "plot", lambda self, q: f"figure of {q}")
        patch.setattr(module, "save", lambda *given: figures.append(given))
        said = write_landings(landings, folder)
    return folder, said, frames, figures


def test_what_is_said_is_of_the_landings_and_their_requirements(landings, written):
    assert written[1] == in_words(landings, landings.judgements()) and any(
        one.startswith("upright: ") for one in written[1]
    )


def test_files_are_those_and_no_others(written):
    folder, _, _, figures = written
    assert {path.name for path in folder.iterdir()} == {
        "landings.nc", "landings.parquet", "requirements.csv", "exceedance-vertical_speed.csv",
        "exceedance-hang_angle.csv", "data_dictionary.csv",
    }  # fmt: skip
    names = ("vertical_speed", "hang_angle")
    assert figures == [(f"figure of {name}", folder, f"landings-{name}") for name in names]


def test_landings_are_stored_for_this_and_for_other_programs(landings, written):
    folder = written[0]
    back = bc.Landings.load(folder / "landings.nc")
    assert back.rows.tobytes() == landings.rows.tobytes() and back.requirements == (SOFT, UPRIGHT)
    frame = pd.read_parquet(folder / "landings.parquet")
    assert "landing" not in frame.columns and len(frame) == 96
    for name, column in landings.table.data_vars.items():
        np.testing.assert_array_equal(frame[name], column.values, err_msg=name)
    assert frame["outcome"].iloc[:3].to_list() == ["diverged", "not down in time", "ok"]


def test_tables_are_those_of_the_noun_to_the_last_digit(landings, written):
    folder, _, frames, _ = written
    tables = {"requirements": requirement_table(landings.judgements())}
    tables |= {f"exceedance-{quantity}": frame for quantity, frame in frames.items()}
    assert len(tables) == 3
    for name, table in tables.items():
        assert (folder / f"{name}.csv").read_text(encoding="utf-8") == table.to_csv(index=False), name


def test_a_frame_is_written_without_its_index(tmp_path):
    frame = pd.DataFrame({"a": [0.1 + 0.2, 1e-300], "b": ["x", "y, z"]}, index=[7, 8])
    write_csv(frame, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines() == ["a,b", "0.30000000000000004,x", '1e-300,"y, z"']


def test_without_a_requirement_the_vertical_speed_is_shown(landings, written, tmp_path, monkeypatch):
    drawn, bare = [], replace(landings, requirements=())
    monkeypatch.setattr(bc.Landings, "exceedance", lambda self, q: written[2][q])
    monkeypatch.setattr(bc.Landings, "plot", lambda self, q: q)
    monkeypatch.setattr(module, "save", lambda *given: drawn.append(given))
    write_landings(bare, tmp_path)
    assert {path.stem for path in tmp_path.glob("exceedance*")} == {"exceedance-vertical_speed"}
    assert drawn == [("vertical_speed", tmp_path, "landings-vertical_speed")]
    assert "exceedance-vertical_speed.csv" in set(dictionary(bare)["file"])


def test_the_dictionary_names_every_column_of_every_table(landings, written):
    folder = written[0]
    told = pd.read_csv(folder / "data_dictionary.csv", keep_default_na=False)
    assert list(told.columns) == ["file", "column", "unit", "meaning"] and not told.duplicated(["file", "column"]).any()
    assert (told[["unit", "meaning"]] != "").all(axis=None)
    by_file = told.groupby("file")["column"].agg(list).to_dict()
    assert sorted(by_file["landings.parquet"]) == sorted(pd.read_parquet(folder / "landings.parquet").columns)
    for name in ("requirements.csv", "exceedance-vertical_speed.csv", "exceedance-hang_angle.csv"):
        assert by_file[name] == list(pd.read_csv(folder / name).columns), name
    assert by_file["aero_tables.csv"] == list(aero_table(small_plan().models[0]).columns)
    assert len(by_file) == 6 and "rocketpy_parachutes.json" in by_file


def test_the_dictionary_has_units_and_meanings_of_all_measures(landings):
    told = dictionary(landings).set_index(["file", "column"])
    for name, (unit, meaning) in MEASURES.items():
        assert told.loc[("landings.parquet", name)].to_list() == [unit, meaning]
    for name in IDS:
        assert (
            name in told.loc[("landings.parquet", name), "meaning"]
            and told.loc[("landings.parquet", name), "unit"] == "1"
        )
    shared = ("posterior_low", "posterior_high")
    for name in shared:
        low, high = (told.loc[(file, name)].to_list() for file in ("requirements.csv", "exceedance-hang_angle.csv"))
        assert low == high


class Known(dict):
    """The part of a posterior that goes into files."""

    @property
    def names(self):
        return tuple(self)


@pytest.fixture(scope="module")
def handed(tmp_path_factory):
    """What other programs get, of twelve draws in three models; what was asked of their own files, which are not made."""
    plan, rng, folder, asked = small_plan(), np.random.default_rng(1), tmp_path_factory.mktemp("others"), []
    (one,) = plan.models
    plan = replace(plan, models=tuple(replace(one, theta=some) for some in np.split(one.theta, [5, 8])))
    known = Known({
        "axial[1]": xr.DataArray(rng.normal(0.9, 0.1, (2, 100)), dims=("chain", "draw")),
        "riser_length": xr.DataArray(rng.normal(71.0, 0.1, (2, 100)), dims=("chain", "draw"), attrs={"units": "m"}),
    })  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "write_other_programs", lambda *given: asked.append(given) or ["why"])
        said = [write_for_others(known, plan, folder, "drop", 7), write_for_others(known, plan, folder)]
    return plan, known, folder, said, asked


def test_parameters_are_the_whole_posteriors_with_their_units(handed):
    _, known, folder, *_ = handed
    told = pd.read_csv(folder / "parameters" / "marginals.csv", index_col=0)
    assert told.index.to_list() == ["axial[1]", "riser_length"] and told["unit"].to_list() == ["1", "m"]
    assert told["mean"].to_list() == pytest.approx([float(x.mean()) for x in known.values()], rel=1e-9)
    draws = pd.read_parquet(folder / "parameters" / "draws.parquet")
    np.testing.assert_array_equal(draws["riser_length"], known["riser_length"].values.ravel())


def test_aerodynamics_are_of_the_draws_that_landed_counted_through_the_models(handed):
    """As if all were of one model."""
    read, whole = pd.read_csv(handed[2] / "aero_tables.csv"), aero_table(small_plan().models[0])
    assert sorted(set(read["draw"])) == list(range(12))
    pd.testing.assert_frame_equal(read, whole, check_dtype=False, rtol=1e-12)


def test_other_programs_are_asked_by_the_campaigns_name(handed):
    plan, _, folder, said, asked = handed
    assert asked == [(plan, "drop", folder, 7), (plan, "canopies", folder, 0)] and said == [["why"], ["why"]]
