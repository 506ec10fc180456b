"""Landings of a campaign, batch by batch, in this process or over Dask; finished batches are kept."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayeschute.calibration.workers import Lost, client_of, finished
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.fly_landings import BATCH, fly, nested
from bayeschute.landing.measures import ROW

Rows = NDArray[np.void]
Progress = Callable[[str, float, str], None]
_AHEAD = 3  # batches per core under way at once
_FILE = "campaign.json"


class Part(NamedTuple):
    """Consecutive landings of a campaign that are flown and kept together."""

    first: int
    size: int


def parts(landings: int) -> list[Part]:
    """All batches of a campaign, in order."""
    return [Part(at, min(BATCH, landings - at)) for at in range(0, landings, BATCH)]


def rounds(count: int) -> list[int]:
    """Numbers of batches after which requirements are judged: doublings, and the end."""
    made, at = [], 1
    while at < count:
        made.append(at)
        at *= 2
    return [*made, count]


def fly_part(part: Part, plan: CampaignPlan) -> Rows:
    """Rows of a batch."""
    return fly(plan, nested(plan.draws, part.size, part.first))


def fly_campaign(
    plan: CampaignPlan,
    landings: int,
    folder: Path | None = None,
    identity: str = "",
    workers: int = 1,
    address: str | None = None,
    progress: Progress | None = None,
    enough: Callable[[Rows], tuple[bool, str]] | None = None,
) -> Rows:
    """Fly landings until there are enough.

    Args:
        plan: What they are drawn from.
        landings: At most so many.
        folder: Where batches are kept as they come, and where those of an earlier call are found; None: nowhere.
        identity: Hash of all that rows depend on.
        workers: Local processes; 1: this one, on all its cores.
        address: Of a Dask scheduler, in place of local processes.
        progress: Called with a name, the share done and words.
        enough: Asked after 1, 2, 4, 8 .. batches whether that will do, and what to say; it sees all batches so far in
            order, so that where a campaign ends doesn't depend on the workers.

    Returns:
        Rows in order.

    Raises:
        InputError: If the folder holds another campaign's landings, Dask is not there, or a batch kills its workers.
    """
    todo, say = parts(landings), progress or (lambda *_: None)
    known = _kept(folder, identity, todo) if folder is not None else {}
    began, old, words = time.perf_counter(), len(known), ""
    with client_of(workers if len(known) < len(todo) else 1, address if len(known) < len(todo) else None) as client:
        for end in rounds(len(todo)):
            wanted = [part for part in todo[:end] if part not in known]
            for part, made in finished(partial(fly_part, plan=plan), wanted, client, _AHEAD):
                if isinstance(made, Lost):
                    do = "Give the command again: finished batches are kept; if it is memory, with fewer workers."
                    raise InputError(Fault("land", f"worker lost: {made.why}"[:300], "landings flown to their end", do))
                known[part] = made
                if folder is not None:
                    write_whole(_path(folder, part), partial(np.save, arr=made))
                done = sum(one.size for one in known)
                left = (time.perf_counter() - began) / (len(known) - old) * (len(todo) - len(known))
                say("land", len(known) / len(todo), f"{done} of {landings}, at most {left / 60.0:.1f} min left{words}")
            rows = np.concatenate([known[part] for part in todo[:end]])
            if enough is not None:
                stop, told = enough(rows)
                words = f"; {told}" if told else ""
                say("land", len(rows) / landings, f"{len(rows)} of {landings}{words}")
                if stop:
                    break
    say("land", 1.0, f"{len(rows)} landings{words}")
    return rows


def _path(folder: Path, part: Part) -> Path:
    return folder / "rows" / f"{part.first:09d}-{part.size}.npy"


def _kept(folder: Path, identity: str, todo: Sequence[Part]) -> dict[Part, Rows]:
    """Batches that a folder holds; the folder is this campaign's from now on."""
    mark = folder / _FILE
    if mark.is_file():
        try:
            said = json.loads(mark.read_text(encoding="utf-8")).get("identity")
        except ValueError:
            said = "unreadable"
        if said != identity:
            do = "Choose another folder, or remove this one."
            raise InputError(Fault(str(folder), "landings of another campaign or posterior", "those of this one", do))
    else:
        write_whole(mark, lambda path: path.write_text(json.dumps({"identity": identity}) + "\n", encoding="utf-8"))
    found = {}
    for part in todo:
        rows = _read(_path(folder, part))
        if rows is not None and rows.shape == (part.size,):
            found[part] = rows
    return found


def _read(path: Path) -> Rows | None:
    """A batch; None where it isn't there or isn't whole, in which case it is flown again."""
    try:
        rows = np.load(path)
    except (OSError, ValueError, EOFError):
        return None
    return rows if rows.dtype == ROW else None
