"""Campaigns that are stopped, killed, resumed and shared out leave the same rows."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from tests.landing.plans import small_plan

from bayeschute.calibration.workers import client_of, finished
from bayeschute.core.errors import InputError
from bayeschute.landing.fly_landings import fly, nested
from bayeschute.study.landing_campaign import landing_rows
from bayeschute.study.landing_campaign.landing_rows import Part, fly_campaign, fly_part, parts, rounds


@pytest.fixture(scope="module")
def plan():
    return small_plan()


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    monkeypatch.setattr(landing_rows, "BATCH", 16)


def test_parts_and_rounds():
    assert parts(40) == [Part(0, 16), Part(16, 16), Part(32, 8)]
    assert rounds(1) == [1] and rounds(8) == [1, 2, 4, 8] and rounds(11) == [1, 2, 4, 8, 11]


def test_a_campaign_that_was_stopped_goes_on(plan, tmp_path, monkeypatch):
    whole = fly_campaign(plan, 40)
    assert whole.tobytes() == np.concatenate([fly_part(part, plan) for part in parts(40)]).tobytes()

    def stopped(part, plan):
        if part.first >= 16:
            raise KeyboardInterrupt
        return fly_part(part, plan)

    monkeypatch.setattr(landing_rows, "fly_part", stopped)
    with pytest.raises(KeyboardInterrupt):
        fly_campaign(plan, 40, tmp_path, "a")
    flown = []
    monkeypatch.setattr(landing_rows, "fly_part", lambda part, plan: flown.append(part) or fly_part(part, plan))
    assert fly_campaign(plan, 40, tmp_path, "a").tobytes() == whole.tobytes()
    assert flown == parts(40)[1:]
    (tmp_path / "rows" / "000000016-16.npy").write_bytes(b"half a file")
    flown.clear()
    assert fly_campaign(plan, 40, tmp_path, "a").tobytes() == whole.tobytes() and flown == [Part(16, 16)]
    more = fly_campaign(plan, 64, tmp_path, "a")
    np.testing.assert_allclose(more["vertical_speed"][:40], whole["vertical_speed"], rtol=1e-11)
    assert more[:32].tobytes() == whole[:32].tobytes() and len(more) == 64


def test_the_folder_of_another_campaign_is_refused(plan, tmp_path):
    fly_campaign(plan, 16, tmp_path, "a")
    with pytest.raises(InputError, match="another campaign"):
        fly_campaign(plan, 16, tmp_path, "b")


def test_it_stops_when_there_are_enough(plan):
    seen = []

    def enough(rows):
        seen.append(len(rows))
        return len(rows) >= 30, "words"

    told = []
    rows = fly_campaign(plan, 200, progress=lambda *said: told.append(said), enough=enough)
    assert seen == [16, 32] and len(rows) == 32 and told[-1][:2] == ("land", 1.0) and "words" in told[-1][2]


def _killed_once(part, plan, mark):
    if part.first == 16 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), 9)
    return fly_part(part, plan)


def test_workers_leave_the_same_rows_and_a_killed_one_loses_nothing(plan, tmp_path):
    alone = fly_campaign(plan, 40)
    mark = tmp_path / "killed"
    with client_of(2, None) as client:
        made = dict(finished(partial(_killed_once, plan=plan, mark=mark), parts(40), client, 2))
    assert mark.exists()
    assert np.concatenate([made[part] for part in parts(40)]).tobytes() == alone.tobytes()


def test_another_seed_is_another_campaign(plan):
    assert fly(replace(plan, seed=9), nested(plan.draws, 4)).tobytes() != fly(plan, nested(plan.draws, 4)).tobytes()
