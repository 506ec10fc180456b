"""One run at a time in a folder: two would write the same files, and each could take the other's half for a whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bayeschute.core.errors import Fault, InputError


@contextmanager
def alone_in(folder: Path | str) -> Iterator[None]:
    """Hold a folder, which is made where it is missing; the system lets go of it when the process ends in any way.

    Where the system has no such locks (Windows, some network drives) nothing is held.

    Args:
        folder: Of the run. One that was made here and in which nothing was written is removed.

    Raises:
        InputError: If another run holds it.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    place = Path(folder)
    made = not place.exists()
    place.mkdir(parents=True, exist_ok=True)
    handle = os.open(place, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            do = "Wait for its end, or choose another --out."
            fault = Fault(str(folder), "a folder in which another run is under way", "one run at a time", do)
            raise InputError(fault) from error
        except OSError:
            pass  # of a drive without locks
        yield
    finally:
        os.close(handle)
        if made:
            with suppress(OSError):  # it holds something
                place.rmdir()
