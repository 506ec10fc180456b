"""A posterior in one NetCDF file: the DataTree's groups, and one more with study, records and fits.

The file ends with its SHA-256, which NetCDF readers pass over: a byte that a failing disk or another program changed
would change numbers without a sign.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
import xarray as xr

from bayeschute.api.workspace import KEPT, Files, collected
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.netcdf_files import write_netcdf
from bayeschute.core.version import __version__
from bayeschute.study.archive import study_from_plain, study_to_plain
from bayeschute.study.load import load_study
from bayeschute.study.stage_keys import ARTEFACT_VERSION
from bayeschute.study.study import Study

_GROUP, _STUDY, _FILE = "bayeschute", "study", "file "
_RUN_DRAWS = "posterior.nc"  # of a run, whose records and fits lie beside it
_SEAL = b"\nbayeschute sha256 "
_END = len(_SEAL) + 2 * hashlib.sha256().digest_size
_WANTED = "a posterior written by `Posterior.save` or `bayeschute fit`, or the folder of a run"
Content = tuple[Study, xr.DataTree, Files]
"""The study that was fitted, the draws, and files of records and fits."""


def write_posterior(path: Path, study: Study, data: xr.DataTree, files: Files) -> Path:
    """Write a posterior; returns the path."""
    header = {"format": ARTEFACT_VERSION, "version": __version__, _STUDY: study_to_plain(study)}
    content = {_STUDY: json.dumps(header).encode(), **{f"{_FILE}{name}": held for name, held in files.items()}}
    stored = xr.Dataset(
        {
            f"content_{i}": (f"byte_{i}", np.frombuffer(held, np.uint8), {"name": name})
            for i, (name, held) in enumerate(content.items())
        }
    )
    tree = data.copy()
    tree[_GROUP] = xr.DataTree(stored)

    def write(aside: Path) -> None:
        write_netcdf(tree, aside)
        seal = _SEAL + _sha256(aside, aside.stat().st_size).encode()
        with aside.open("ab") as file:
            file.write(seal)

    write_whole(path, write)
    return path


def _sha256(path: Path, length: int) -> str:
    """Of a file's first bytes."""
    made = hashlib.sha256()
    with path.open("rb") as file:
        while length > 0 and (part := file.read(min(length, 1 << 20))):
            made.update(part)
            length -= len(part)
    return made.hexdigest()


def _end_of(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - _END, 0))
        return file.read()


def _sealed(path: Path) -> bool:
    """Whether a file ends as `write_posterior` ends one."""
    return _end_of(path).startswith(_SEAL)


def _check_whole(path: Path) -> None:
    """Raise an `InputError` unless the file ends with the hash of what goes before."""
    if not _sealed(path):
        got = "no checksum at its end: no posterior, cut short, changed by another program, or of an earlier version"
    elif _end_of(path) != _SEAL + _sha256(path, path.stat().st_size - _END).encode():
        got = "content that is not that of its checksum: it was damaged, or changed by another program"
    else:
        return
    raise InputError(Fault(str(path), got, _WANTED, "Copy it again, or fit again."))


def read_posterior(path: Path) -> Content:
    """Read what `write_posterior` wrote, or the posterior of a run: its folder, or the posterior.nc in it.

    Raises:
        InputError: If the file is not one, was damaged or changed since, or is another version's; if a run was not
            fitted.
    """
    folder = _run_of(path)
    if folder is not None:
        return posterior_of_run(folder, load_study(folder / "study.toml"))
    if not path.is_file():
        got = "a folder that holds no run" if path.is_dir() else "no such file"
        raise InputError(Fault(str(path), got, _WANTED))
    _check_whole(path)
    tree = _loaded(path)
    try:
        stored = tree[_GROUP].to_dataset()
        content = {one.attrs["name"]: one.values.astype(np.uint8).tobytes() for one in stored.data_vars.values()}
        header = json.loads(content[_STUDY])
    except (KeyError, ValueError) as error:
        raise InputError(Fault(str(path), f"a file without what a posterior has ({error})"[:200], _WANTED)) from None
    if header.get("format") != ARTEFACT_VERSION:
        got = f"format {header.get('format')} of version {header.get('version')}"
        raise InputError(Fault(str(path), got, f"format {ARTEFACT_VERSION}", "Use the version that wrote it."))
    files = {name.removeprefix(_FILE): held for name, held in content.items() if name.startswith(_FILE)}
    for name in files:  # they are written to a temporary folder, and to no other
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\\" in name:
            raise InputError(Fault(str(path), f"a file named {name!r}", _WANTED, "Don't use it: it is not ours."))
    groups = {name: node.to_dataset() for name, node in tree.children.items() if name != _GROUP}
    return study_from_plain(header[_STUDY]), xr.DataTree.from_dict(groups), files


def _run_of(path: Path) -> Path | None:
    """Folder of the run that is meant by a folder, or by its draws; None where a path means none."""
    draws = path.name == _RUN_DRAWS and path.is_file() and not _sealed(path)
    folder = path if path.is_dir() else path.parent if draws else None
    if folder is None or not (folder / "study.toml").is_file():
        return None
    return folder if path.is_dir() or (folder / "fit").is_dir() else None


def posterior_of_run(folder: Path, study: Study) -> Content:
    """The posterior of a finished run, without what was only predicted, and without requirements.

    Raises:
        InputError: If the run has none.
    """
    if not (folder / _RUN_DRAWS).is_file():
        do = "Let the run finish: `bayeschute run STUDY --out DIR --resume`."
        raise InputError(Fault(str(folder), f"no {_RUN_DRAWS}", "the folder of a run that was fitted", do))
    fitted = tuple(f for f in study.flights if {"identify", "structure"} & set(f.roles))
    records = {f"flights/{f.name}{ending}" for f in fitted for ending in (".nc", ".truth.nc")}
    kept = collected(folder, KEPT).items()
    files = {name: held for name, held in kept if not name.startswith("flights/") or name in records}
    return replace(study, flights=fitted, requirements=()), _loaded(folder / _RUN_DRAWS), files


def _loaded(path: Path) -> xr.DataTree:
    try:
        with xr.open_datatree(path, engine="h5netcdf") as opened:
            return opened.load()
    except (OSError, KeyError, ValueError) as error:
        raise InputError(Fault(str(path), f"a file that can't be read ({error})"[:200], _WANTED)) from None
