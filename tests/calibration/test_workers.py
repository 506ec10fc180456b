"""Tasks among processes: inputs keep their results, few are under way at once, and a task that kills is told."""

from __future__ import annotations

import os
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from bayeschute.calibration import workers
from bayeschute.calibration.workers import Lost, client_of, finished, kept_open
from bayeschute.core.errors import InputError

distributed = pytest.importorskip("distributed", reason="Dask is not installed")
dask = pytest.importorskip("dask")


def square(number: int) -> int:
    """A task."""
    return number**2


def kills_on_three(number: int) -> int:
    """A task that takes its worker with it for one of its inputs."""
    if number == 3:
        os.kill(os.getpid(), 9)
    return square(number)


def marked(number: int, folder: Path) -> int:
    """A task that leaves a trace."""
    (folder / str(number)).touch()
    return number


def careless(number: int) -> int:
    """A task whose library warns."""
    warnings.warn("a library is not at ease", RuntimeWarning, stacklevel=1)
    return number


def test_one_worker_is_this_process_and_keeps_the_order():
    with client_of(1, None) as client:
        assert client is None
        assert list(finished(square, [3, 1, 2], client)) == [(3, 9), (1, 1), (2, 4)]


def test_every_input_comes_back_once_and_only_the_one_that_kills_is_lost():
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),  # one death is enough: sooner done
        client_of(2, None) as client,
    ):
        made = dict(finished(kills_on_three, range(8), client))
    lost = made.pop(3)
    assert isinstance(lost, Lost) and "died" in lost.why
    assert made == {n: n**2 for n in range(8) if n != 3}


def test_local_workers_that_are_gone_for_good_are_told_and_not_waited_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(workers, "PATIENCE", 0.5)
    monkeypatch.setattr(workers, "_LOOK", 0.1)
    with client_of(2, None) as client:
        coming = finished(square, range(5), client, ahead=1)
        next(coming)
        client.cluster.scale(0)
        while client.nthreads():
            time.sleep(0.1)
        with pytest.raises(InputError, match="none came back"):
            list(finished(square, range(5), client))


def test_warnings_of_workers_are_given_here_and_not_on_the_screen(capfd):
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        with client_of(2, None) as client:
            assert dict(finished(careless, [1, 2], client)) == {1: 1, 2: 2}
            for _ in range(100):
                if any("not at ease" in str(one.message) for one in given):
                    break
                time.sleep(0.05)
    assert any("RuntimeWarning of a worker: a library is not at ease" in str(one.message) for one in given)
    assert "not at ease" not in capfd.readouterr().err


def test_no_more_tasks_are_sent_than_there_is_room_for(tmp_path: Path):
    with client_of(2, None) as client:
        coming = finished(partial(marked, folder=tmp_path), range(40), client, ahead=2)
        next(coming)
        assert len(list(tmp_path.iterdir())) <= 4
        assert len(list(coming)) == 39
    assert len(list(tmp_path.iterdir())) == 40


def pid(number: int) -> int:
    """Which process does it."""
    return os.getpid()


def test_workers_kept_open_serve_several_campaigns():
    with kept_open(2) as address:
        assert address is not None
        served = []
        for _ in range(2):
            with client_of(1, address) as client:
                served.append({where for _, where in finished(pid, range(20), client)})
        assert len(served[0] | served[1]) == 2 and os.getpid() not in served[0]
    with kept_open(1) as none, kept_open(2, "tcp://there:1") as there:
        assert none is None and there == "tcp://there:1"


def test_workers_leave_dasks_scheduler_to_whoever_calls():
    before = dask.config.get("scheduler", None)
    with kept_open(2) as address, client_of(1, address) as client:
        assert dict(finished(square, [1, 2], client)) == {1: 1, 2: 4}
        assert dask.config.get("scheduler", None) == before
        with pytest.raises(ValueError, match="No clients found"):
            distributed.default_client()
    assert dask.config.get("scheduler", None) == before


def cores(number: int) -> frozenset[int]:
    """Where the threads that a task starts may run."""
    with ThreadPoolExecutor(1) as pool:
        return frozenset(pool.submit(os.sched_getaffinity, 0).result())


def dies_once(number: int, folder: Path) -> frozenset[int]:
    """A task whose first worker dies of it."""
    if not (folder / "dead").exists():
        (folder / "dead").touch()
        os.kill(os.getpid(), 9)
    return cores(number)


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="no affinity here")
def test_local_workers_share_the_cores_out_also_after_one_died(tmp_path: Path):
    here = os.sched_getaffinity(0)
    for task in (cores, partial(dies_once, folder=tmp_path)):
        with client_of(2, None) as client:
            found = {on for _, on in finished(task, range(20), client)}
        whole = frozenset().union(*found)
        assert whole <= here and all(len(on) <= -(-len(here) // 2) for on in found)
        assert len(here) < 2 or len(found) < 2 or not frozenset.intersection(*found)


def trims(number: int) -> str | None:
    """Whether freed memory goes back at once."""
    return os.environ.get("MALLOC_TRIM_THRESHOLD_")


def test_local_workers_keep_the_memory_that_they_free(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)
    with client_of(2, None) as client:
        assert {found for _, found in finished(trims, range(4), client)} == {None}
    assert "MALLOC_TRIM_THRESHOLD_" in dask.config.get("distributed.nanny.pre-spawn-environ")


def test_a_scheduler_that_is_not_there_is_bad_input():
    with pytest.raises(InputError, match="a Dask scheduler"), client_of(2, "not-an-address"):
        pass
