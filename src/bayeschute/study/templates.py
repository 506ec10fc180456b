"""Template files to begin with: a vehicle, commented studies and a campaign of landings, shipped with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from bayeschute.core.errors import Fault, InputError

NAMES = ("vehicle.toml", "virtual.toml", "cluster.toml", "descent.toml", "landing.toml", "candidate-drops.toml")


def template(name: str) -> Path:
    """Path of a shipped file, one of `NAMES`."""
    return Path(str(resources.files("bayeschute").joinpath("templates", name)))


def copy_templates(folder: Path | str) -> list[Path]:
    """Copy the shipped files into a folder, which is made where it is missing.

    Args:
        folder: Where to.

    Returns:
        The files written.

    Raises:
        InputError: If one of the files exists already (nothing is written then) or the folder can't be written.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(Fault(str(folder), "a file", "a folder, which may exist", "Choose another path."))
    there = [folder / name for name in NAMES if (folder / name).exists()]
    if there:
        raise InputError(Fault(str(path), "a file that exists", "no such file yet", "Move it away.") for path in there)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in NAMES:
            (folder / name).write_bytes(template(name).read_bytes())
    except OSError as error:
        raise InputError(Fault(str(folder), f"{error.strerror}", "a folder that can be written")) from error
    return [folder / name for name in NAMES]
