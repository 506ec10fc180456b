"""Provenance of a stored number: command, commit, date, machine, versions of the packages, hash of the numerics."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bayeschute.core.version import __version__
from bayeschute.study.evidence.numerics_hash import numerics

_PACKAGES = ("jax", "numpy", "scipy")


def provenance(command: str) -> dict[str, Any]:
    """What a stored result says of its making.

    Args:
        command: The command line that makes the result again.

    Returns:
        ``command``; ``commit`` of the checkout, marked where files were changed, None outside of a checkout; ``date``
        (UTC); ``machine`` (processor, cores, system); ``versions``; ``numerics``, their hash.
    """
    python = platform.python_version()
    return {
        "command": command,
        "commit": commit(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
        "versions": {"bayeschute": __version__, **{name: version(name) for name in _PACKAGES}, "python": python},
        "numerics": numerics(),
    }


def commit() -> str | None:
    """Commit of the checkout that the package lies in, ``+`` where files differ from it; None where it lies in none."""
    place = Path(__file__).parent
    try:
        said = [
            subprocess.run(["git", *words], cwd=place, capture_output=True, text=True, check=True, timeout=10).stdout
            for words in (["rev-parse", "HEAD"], ["ls-files", "--error-unmatch", Path(__file__).name])
        ]
        changed = subprocess.run(["git", "diff", "--quiet", "HEAD"], cwd=place, capture_output=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None  # no git, or a package that is installed
    return said[0].strip() + "+" * bool(changed.returncode)
