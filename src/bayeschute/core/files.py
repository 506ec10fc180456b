"""Atomic file writing: a file is written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import uuid4


def write_whole(path: Path, write: Callable[[Path], Any], shared: bool = False) -> None:
    """Write a file aside, then move it into place.

    Args:
        path: The file; its folder is made if missing.
        write: Writes the file at the path it is given, which has the same suffix. Where it fails, nothing is left.
        shared: Whether several processes or threads may write this file at once. Each has a separate temporary file
            then, and a process that is killed leaves it; else the next one that writes the file takes its place.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.stem}{'.' + uuid4().hex if shared else ''}.part{path.suffix}")
    try:
        write(aside)
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
