"""Location of results that are shipped with the program."""

from __future__ import annotations

from importlib import resources
from pathlib import Path


def shipped(stored: Path) -> Path:
    """Folder of results that come with the program.

    Data of the package where it is installed; in a checkout, and so in an editable install, below ``models``.

    Args:
        stored: Folder below either, such as ``reference/calibration``.
    """
    package = Path(str(resources.files("bayeschute")))
    installed = package / stored
    return installed if installed.is_dir() else package.parents[1] / "models" / stored
