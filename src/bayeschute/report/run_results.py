"""Reads the results of a run folder; files that are missing or unreadable are listed in the report."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import xarray as xr

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.netcdf_files import load_groups
from bayeschute.core.plain import from_plain
from bayeschute.posterior.assess.identifiability_result import FitIdentifiability

T = TypeVar("T")
RISK_TABLES = ("marginals", "exceedance", "tolerance")


def entries(value: Any) -> dict[str, Mapping[str, Any]]:
    """The mappings of a mapping by name; nothing where it is no mapping."""
    items = value.items() if isinstance(value, Mapping) else ()
    return {str(name): facts for name, facts in items if isinstance(facts, Mapping)}


def mappings(items: Any) -> list[Mapping[str, Any]]:
    """The mappings of a list; nothing where it is no list."""
    return [i for i in items if isinstance(i, Mapping)] if isinstance(items, list | tuple) else []


@dataclass(frozen=True)
class Results:
    """The contents of a run folder.

    Attributes:
        folder: The run folder.
        summary: summary.json.
        structure: structure.json, empty if absent.
        posterior: Parameter name to draws (chain, draw).
        prior: Parameter name to draws (chain, draw).
        predictions: Flight name to its bands.
        flights: Flight name to its record.
        risk: File stem to table; those of the folder that the report shows.
        absent: Sentences on what is missing.
        curves: curves.csv; None where the run has none, as that of a point mass.
        identifiability: Of every fit, by its name; of the summary.
    """

    folder: Path
    summary: Mapping[str, Any]
    structure: Mapping[str, Any]
    posterior: Mapping[str, np.ndarray]
    prior: Mapping[str, np.ndarray]
    predictions: Mapping[str, xr.Dataset]
    flights: Mapping[str, xr.Dataset]
    risk: Mapping[str, pd.DataFrame]
    absent: tuple[str, ...]
    curves: pd.DataFrame | None = None
    identifiability: Mapping[str, FitIdentifiability] = field(default_factory=dict)

    def part(self, name: str) -> Mapping[str, Any]:
        """A mapping of the summary, empty where it is missing or something else."""
        value = self.summary.get(name)
        return value if isinstance(value, Mapping) else {}

    def table(self, stem: str, *needed: str) -> pd.DataFrame | None:
        """A risk table; None where it is missing or empty, or lacks a column that is needed."""
        table = self.risk.get(stem)
        return None if table is None or table.empty or not set(needed) <= set(table.columns) else table


def _summary(path: Path) -> dict[str, Any]:
    """summary.json, the one file that a report needs."""
    wanted = "the summary of a finished run"
    try:
        return json_object(path)
    except FileNotFoundError:
        if (path.parent / "log.txt").exists():
            do = f"Let it finish: `bayeschute run STUDY --out {path.parent} --resume`."
            raise InputError(Fault(str(path.parent), "a run that has not come to its end", wanted, do)) from None
        raise InputError(Fault(str(path), "no such file", wanted, "Run `bayeschute run` first.")) from None
    except ValueError as error:
        raise InputError(Fault(str(path), f"text that is no JSON object ({error})", wanted)) from None


def try_read(path: Path, read: Callable[[Path], T], absent: list[str], loss: str) -> T | None:
    """Read a file, or note what the report lacks without it."""
    if not path.exists():
        absent.append(f"{path.name} is not in the run folder: {loss}.")
        return None
    try:
        return read(path)
    except (OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        absent.append(f"{path.name} could not be read ({reason}): {loss}.")
        return None


def json_object(path: Path) -> dict[str, Any]:
    """A JSON object from a file."""
    loaded = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(loaded, dict):
        raise ValueError(f"holds a {type(loaded).__name__}, not an object")
    return loaded


def _tree(path: Path) -> dict[str, xr.Dataset]:
    """All first-level groups of a NetCDF file, in memory."""
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        return {str(name): node.to_dataset().load() for name, node in tree.children.items()}


def _before_and_after(path: Path) -> tuple[xr.Dataset, ...]:
    """Draws of the parameters before and after the data, of ``posterior.nc``."""
    return load_groups(path, "prior", "posterior")


def _dataset(path: Path) -> xr.Dataset:
    """One NetCDF file, in memory."""
    with xr.open_dataset(path, engine="h5netcdf") as data:
        return data.load()


def _scalars(group: xr.Dataset | None) -> dict[str, np.ndarray]:
    """Variables with dims (chain, draw) only."""
    if group is None:
        return {}
    return {
        str(name): np.asarray(values.transpose("chain", "draw").values, dtype=float)
        for name, values in group.data_vars.items()
        if set(values.dims) == {"chain", "draw"}
    }


def identifiability_of(summary: Mapping[str, Any], absent: list[str]) -> dict[str, FitIdentifiability]:
    """Identifiability by fit of a summary, or a note of what the report lacks without it."""
    try:
        return from_plain(dict[str, FitIdentifiability], summary.get("identifiability", {}), "identifiability")
    except InputError as error:
        told = "; ".join(map(str, error.faults))
        absent.append(f"summary.json has identifiability results of another form ({told}): they are not shown.")
        return {}


def read_results(run_dir: Path) -> Results:
    """Read a run folder.

    Args:
        run_dir: Folder that `bayeschute run` wrote.

    Returns:
        Its contents; optional files that are missing or unreadable are named in `absent`.

    Raises:
        InputError: If summary.json is missing or is no JSON object.
    """
    summary = _summary(run_dir / "summary.json")
    absent: list[str] = []
    structure = try_read(run_dir / "structure.json", json_object, absent, "no structure is shown") or {}
    loss = "no prior and posterior curves, correlations and chains are shown"
    prior, posterior = try_read(run_dir / "posterior.nc", _before_and_after, absent, loss) or (None, None)
    predictions = try_read(run_dir / "predictions.nc", _tree, absent, "no bands are shown") or {}
    flights = {}
    for path in sorted((run_dir / "flights").glob("*.nc")):
        if "truth" in path.stem:
            continue
        record = try_read(path, _dataset, absent, "this record is not drawn")
        if record is not None:
            flights[path.stem] = record
    if not flights:
        absent.append("flights/ contains no records: they are not drawn.")
    risk = {}
    for stem in RISK_TABLES:
        table = try_read(run_dir / "risk" / f"{stem}.csv", pd.read_csv, absent, "this risk table is not shown")
        if table is not None:
            risk[stem] = table
    curves = None
    if (run_dir / "curves.csv").exists():
        curves = try_read(run_dir / "curves.csv", pd.read_csv, absent, "no aerodynamic curves are shown")
    identifiability = identifiability_of(summary, absent)
    return Results(
        folder=run_dir,
        summary=summary,
        structure=structure,
        posterior=_scalars(posterior),
        prior=_scalars(prior),
        predictions=predictions,
        flights=flights,
        risk=risk,
        absent=tuple(absent),
        curves=curves,
        identifiability=identifiability,
    )
