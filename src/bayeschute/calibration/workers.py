"""Parallel execution of tasks: in this process, in local processes, or on a Dask cluster; losses are reported."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

from bayeschute.core.errors import Fault, InputError

T = TypeVar("T")
R = TypeVar("R")
_RETRIES = 3
PATIENCE = 180.0
"""Time without any local worker after which they count as lost [s]; Dask starts one that died again within seconds."""
ANSWERS_WITHIN = 20.0  # [s] that a scheduler may take to answer
_LOOK, _POLL = 5.0, 0.05  # between looks at the workers, and at what is finished [s]


@contextmanager
def client_of(workers: int, address: str | None) -> Iterator[Any]:
    """A Dask client: of a cluster at an address, of local processes, or None where one worker is this process.

    It never becomes Dask's default: arrays and files of whoever calls, whom Dask also serves, keep their own scheduler.

    Raises:
        InputError: If Dask is needed and not installed, or the cluster doesn't answer.
    """
    if workers <= 1 and address is None:
        yield None
        return
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        do = "Install the extra: pip install 'bayeschute[dask]'."
        raise InputError(Fault("--workers/--dask", "Dask is not installed", "the extra `dask`", do)) from error
    if address is not None:
        try:
            client = Client(address, timeout=ANSWERS_WITHIN, set_as_default=False)
        except (OSError, ValueError) as error:
            do = "Start a scheduler (dask scheduler) and workers, or use --workers."
            raise InputError(Fault(f"--dask {address}", str(error), "a Dask scheduler", do)) from error
        with client:
            yield client
        return
    with (
        _for_numbers(),
        LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        client.register_plugin(_own_cores(workers))
        client.register_plugin(_heard())
        yield client


def _for_numbers() -> Any:
    """Context manager: Dask's settings for processes that compute much and store little.

    Dask has them give back every 64 KiB that are freed, for the sake of large data that stays, and looks at what they
    do a hundred times a second. The first costs a fit a quarter of its time.
    """
    import dask

    key = "distributed.nanny.pre-spawn-environ"
    kept = {name: value for name, value in dask.config.get(key).items() if not name.startswith("MALLOC_TRIM")}
    return dask.config.set({key: kept, "distributed.worker.profile.enabled": False})


def _own_cores(workers: int) -> Any:
    """A plugin by which each of several local workers keeps to its share of the cores.

    Compilers and linear algebra start as many threads as they see cores. Two workers that both do so on the same two
    cores take half as long again for each task.
    """
    from distributed import WorkerPlugin

    class OwnCores(WorkerPlugin):
        name = "own-cores"

        def setup(self, worker: Any) -> None:
            if hasattr(os, "sched_setaffinity"):
                cores, place = sorted(os.sched_getaffinity(0)), int(worker.name)
                os.sched_setaffinity(0, cores[place::workers] or [cores[place % len(cores)]])

    return OwnCores()


def _heard() -> Any:
    """A plugin that raises warnings of local workers in this process instead of printing them in theirs."""
    from distributed import Worker, WorkerPlugin

    class Heard(WorkerPlugin):
        name = "heard"

        def setup(self, worker: Worker) -> None:
            import warnings

            def show(message: Any, category: Any, filename: str, lineno: int, *_: Any, **__: Any) -> None:
                worker.log_event("warn", f"{category.__name__} of a worker: {message} ({filename}:{lineno})")

            warnings.showwarning = show

    return Heard()


@contextmanager
def kept_open(workers: int, address: str | None = None) -> Iterator[str | None]:
    """The address of workers that serve several campaigns, so that compiled functions are reused.

    Args:
        workers: Local processes; with 1 the address is None: this process is the worker.
        address: Of a Dask scheduler that is there already; it is given back.

    Raises:
        InputError: As `client_of`.
    """
    if address is not None:
        yield address
        return
    with client_of(workers, None) as client:
        yield None if client is None else str(client.cluster.scheduler_address)


class Lost(NamedTuple):
    """In the place of a result: the task killed every worker that it was given to, and why Dask gave it up."""

    why: str


def finished(
    task: Callable[[T], R], todo: Sequence[T], client: Any, ahead: int | None = None
) -> Iterator[tuple[T, R | Lost]]:
    """Inputs with their results as they are finished.

    Dask blames the death of a worker on everything it was given, so what it gives up is tried again one by one: what
    kills its workers then is the task itself.

    Args:
        task: A function of a module or a partial of one; it returns its failures in its result.
        todo: Its inputs.
        client: From `client_of`.
        ahead: Tasks per core submitted at once, where results are large; all where None.

    Raises:
        InputError: If the connection to the scheduler breaks off, or all local workers die and none comes back.
    """
    if client is None:
        yield from ((one, task(one)) for one in todo)
        return

    def room() -> int:  # each time: workers come and go
        return len(todo) if ahead is None else ahead * max(sum(client.nthreads().values()), 2)

    given_up = []
    for one, result in _spread(task, todo, client, room):
        if isinstance(result, Lost):
            given_up.append(one)
        else:
            yield one, result
    yield from _spread(task, given_up, client, lambda: 1)


def _spread(
    task: Callable[[T], R], todo: Sequence[T], client: Any, room: Callable[[], int]
) -> Iterator[tuple[T, R | Lost]]:
    """Inputs with results or losses as they come, with a bounded number submitted at once."""
    from distributed import as_completed

    waiting, under_way, done = iter(todo), dict[Any, T](), as_completed(loop=client.loop)

    def send() -> None:
        limit = room()
        while len(under_way) < limit and (one := next(waiting, None)) is not None:
            future = client.submit(task, one, retries=_RETRIES, pure=False)
            under_way[future] = one
            done.add(future)

    send()
    for future in _as_finished(done, client):
        one = under_way.pop(future)
        if future.cancelled():
            do = "Start it, and give the same command again: what is finished is kept."
            raise InputError(
                Fault("--workers/--dask", "the connection broke off", "a scheduler that keeps running", do)
            )
        yield one, Lost(str(future.exception())) if future.status == "error" else future.result()
        future.release()
        send()


def _as_finished(futures: Any, client: Any) -> Iterator[Any]:
    """Dask's futures as they are finished; local workers that all died and don't come back end it."""
    if client.cluster is None:  # workers of a cluster may wait for a machine for hours
        yield from futures
        return
    looked = time.monotonic()
    gone: float | None = None  # since when there has been no worker
    while not futures.is_empty():
        if batch := futures.next_batch(block=False):
            yield from batch
            continue
        time.sleep(_POLL)
        now = time.monotonic()
        if now - looked < _LOOK:
            continue
        looked = now
        gone = None if client.nthreads() else gone or now
        if gone is not None and now - gone > PATIENCE:
            do = "Give the same command again: what is finished is kept. Fewer workers have more memory each."
            raise InputError(Fault("--workers", "all workers died and none came back", "workers that live", do))
