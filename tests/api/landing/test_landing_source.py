"""Further landings: in batches, in their order, whatever order these come in, by the workers."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from bayeschute.api.landing import landing_source as module
from bayeschute.api.landing.landing_source import LandingSource
from bayeschute.calibration.workers import Lost
from bayeschute.core.errors import InputError

ROW = np.dtype([("id", np.int64), ("batch", np.int64)])


def ids_of(count):
    """Numbers of landings (N, 6), no two alike."""
    return np.arange(6 * count).reshape(count, 6)


@pytest.fixture
def flown(monkeypatch):
    """Batches of four that fly as told, and the workers that they were given to."""
    told = {"plans": [], "batches": [], "clients": [], "ahead": []}

    def fly(plan, ids):
        told["plans"].append(plan)
        told["batches"].append(len(ids))
        return np.array([(one, len(told["batches"])) for one in ids[:, 0]], ROW)

    @contextmanager
    def client_of(workers, address):
        told["clients"].append((workers, address))
        yield None

    def backwards(task, todo, client, ahead):
        told["ahead"].append(ahead)
        return ((one, task(one)) for one in reversed(todo))

    for name, value in (("BATCH", 4), ("fly", fly), ("client_of", client_of), ("finished", backwards)):
        monkeypatch.setattr(module, name, value)
    return told


@pytest.mark.parametrize(("count", "sizes"), [(1, [1]), (4, [4]), (5, [4, 1]), (11, [4, 4, 3])])
def test_rows_are_in_the_order_of_their_numbers(flown, count, sizes):
    source = LandingSource("campaign", "other plan", "spec", {}, workers=3, address="tcp://x")
    rows = source.fly("plan", ids_of(count))
    np.testing.assert_array_equal(rows["id"], ids_of(count)[:, 0])
    assert flown["batches"] == sizes[::-1] and set(flown["plans"]) == {"plan"} and flown["ahead"] == [3]
    np.testing.assert_array_equal(rows["batch"], np.repeat(np.arange(len(sizes), 0, -1), sizes))


@pytest.mark.parametrize(("count", "workers"), [(4, 1), (5, 3)])
def test_one_batch_needs_no_other_process(flown, count, workers):
    LandingSource("campaign", "plan", "spec", {}, workers=3).fly("plan", ids_of(count))
    assert flown["clients"] == [(workers, None)]


def test_where_it_is_flown_is_handed_on(flown):
    LandingSource("campaign", "plan", "spec", {}, (), 1, "tcp://host:8786").fly("plan", ids_of(1))
    assert flown["clients"] == [(1, "tcp://host:8786")]


def test_a_batch_that_kills_its_workers_ends_it(flown, monkeypatch):
    monkeypatch.setattr(
        module, "finished", lambda task, todo, client, ahead: [(todo[0], Lost("it is too large " * 50))]
    )
    with pytest.raises(InputError, match="land: got worker lost: it is too large .*; wanted landings flown") as caught:
        LandingSource("campaign", "plan", "spec", {}).fly("plan", ids_of(3))
    assert len(caught.value.faults[0].got) == 300


def test_progress_is_told_by_the_question(flown):
    told = []
    say = LandingSource("campaign", "plan", "spec", {}, progress=lambda *said: told.append(said)).say("shares")
    say(0.5, "half")
    assert told == [("shares", 0.5, "half")]
    assert LandingSource("campaign", "plan", "spec", {}).say("shares")(0.5, "half") is None


def test_a_source_is_itself_only():
    """Posteriors and plans are not compared number by number."""
    one, other = (LandingSource("campaign", "plan", "spec", {}) for _ in range(2))
    assert (
        one == one
        and one != other
        and (one.failed_checks, one.workers, one.address, one.progress) == ((), 1, None, None)
    )
