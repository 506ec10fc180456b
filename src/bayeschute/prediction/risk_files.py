"""The files a risk assessor takes away: draws, marginals, correlations, landings, exceedance, tolerance.

Two kinds of doubt are kept apart throughout: what the posterior leaves open (P of meeting a requirement) and what the
finite number of simulated landings leaves open (Clopper-Pearson and Jeffreys limits, Wilks' order statistics). A
landing whose solve failed is never dropped: it counts as one beyond every limit, and stands in a column of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike

from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.prediction.binomial_limits import clopper_pearson, jeffreys, wilks_sample_size
from bayeschute.prediction.landings import (
    TOLERANCES,
    TOUCHDOWN_UNITS,
    exceedance_table,
    tolerance_table,
    touchdown_table,
)
from bayeschute.prediction.marginal_fits import QUANTILES, distribution, fit_marginal
from bayeschute.prediction.requirement import requirement_check

__all__ = [
    "clopper_pearson",
    "correlation_table",
    "draws_table",
    "exceedance_table",
    "jeffreys",
    "marginal_table",
    "requirement_check",
    "tolerance_table",
    "touchdown_table",
    "wilks_sample_size",
    "write_draws",
    "write_risk",
    "write_touchdown",
]


def _csv(frame: pd.DataFrame, path: Path, index: bool = False) -> None:
    """Write a frame as CSV with every digit."""
    write_whole(path, lambda part: frame.to_csv(part, index=index))


def _parquet(frame: pd.DataFrame, path: Path, units: Mapping[str, str]) -> None:
    """Write a frame as Parquet; each field carries its unit, and ``frame.attrs["units"]`` comes back with pandas."""
    frame = frame.copy(deep=False)
    frame.attrs = {"units": dict(units)}
    table = pa.Table.from_pandas(frame, preserve_index=False)
    fields = [field.with_metadata({"unit": units.get(field.name, "1")}) for field in table.schema]
    table = table.cast(pa.schema(fields, metadata=table.schema.metadata))
    write_whole(path, lambda part: pq.write_table(table, part))


def draws_table(draws: Mapping[str, ArrayLike]) -> pd.DataFrame:
    """Joint draws as one frame.

    Args:
        draws: Parameter name to array (chain, draw), or (draw,) for a single chain, SI.

    Returns:
        Columns chain, draw (from 0) and one per parameter.

    Raises:
        InputError: If nothing is given or the shapes differ.
    """
    arrays = {name: np.atleast_2d(np.asarray(values, dtype=float)) for name, values in draws.items()}
    shapes = {values.shape for values in arrays.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise InputError(Fault("draws_table draws", f"shapes {sorted(shapes)}", "one shape (chain, draw) for all"))
    chain, draw = np.indices(next(iter(shapes)))
    columns = {"chain": chain.ravel(), "draw": draw.ravel()}
    return pd.DataFrame(columns | {name: values.ravel() for name, values in arrays.items()})


def _parameters(table: pd.DataFrame) -> list[str]:
    """Names of the parameter columns."""
    return [str(name) for name in table.columns if name not in ("chain", "draw")]


def write_draws(draws: Mapping[str, ArrayLike], folder: Path, units: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Write draws.parquet (units in the metadata), draws.csv and, beside it, draws_units.csv.

    The CSV has one header line and nothing else, so ``pandas.read_csv(path)`` reads it without options.

    Args:
        draws: Parameter name to array (chain, draw), SI.
        folder: Folder of the files; made if missing.
        units: Parameter name to unit; "1" where not named.

    Returns:
        The frame as written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    table = draws_table(draws)
    units = units or {}
    _parquet(table, folder / "draws.parquet", units)
    _csv(table, folder / "draws.csv")
    names = _parameters(table)
    _csv(pd.DataFrame({"column": names, "unit": [units.get(n, "1") for n in names]}), folder / "draws_units.csv")
    return table


def marginal_table(
    table: pd.DataFrame,
    units: Mapping[str, str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    effective: Mapping[str, float] | None = None,
) -> pd.DataFrame:
    """One row per parameter, as a model memo lists it.

    Args:
        table: Frame of `draws_table`.
        units: Parameter name to unit.
        bounds: Parameter name to known limits [unit].
        effective: Parameter name to number of independent draws; all draws where not named.

    Returns:
        Columns parameter, unit, family and its constants, mean, sd, quantiles of the draws, the outer quantiles of the
        family (fit_q00135, fit_q99865: the draws alone say little out there), the statistic of the choice (aic, and
        runner_up with its own), ks_distance, draws, independent_draws.
    """
    rows = []
    for name in _parameters(table):
        x = table[name].to_numpy(dtype=float)
        independent = float((effective or {}).get(name, x.size))
        fit = fit_marginal(x, (bounds or {}).get(name), independent)
        outer = distribution(fit).ppf([QUANTILES["q00135"], QUANTILES["q99865"]])
        row: dict[str, Any] = {"parameter": name, "unit": (units or {}).get(name, "1")} | fit._asdict()
        row |= {"mean": x.mean(), "sd": x.std(ddof=1)}
        row |= dict(zip(QUANTILES, np.quantile(x, list(QUANTILES.values())), strict=True))
        row |= {"fit_q00135": outer[0], "fit_q99865": outer[1], "draws": x.size, "independent_draws": independent}
        rows.append(row)
    return pd.DataFrame(rows)


def correlation_table(table: pd.DataFrame) -> pd.DataFrame:
    """Pearson correlation of the draws [1]; index and columns are the parameters."""
    values = table[_parameters(table)].corr()
    values.index.name = "parameter"
    return values


def write_touchdown(
    flights: Mapping[str, Mapping[str, ArrayLike]], folder: Path, units: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """Write touchdown.parquet; units of ``TOUCHDOWN_UNITS`` and of `units` go into its metadata."""
    folder.mkdir(parents=True, exist_ok=True)
    table = touchdown_table(flights)
    _parquet(table, folder / "touchdown.parquet", TOUCHDOWN_UNITS | dict(units or {}))
    return table


def write_risk(
    folder: Path,
    draws: Mapping[str, ArrayLike],
    flights: Mapping[str, Mapping[str, ArrayLike]] | None = None,
    units: Mapping[str, str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    effective: Mapping[str, float] | None = None,
    thresholds: Mapping[str, Sequence[float]] | None = None,
    independent: float | None = None,
) -> dict[str, pd.DataFrame]:
    """Write every file of the risk folder.

    Args:
        folder: Usually ``DIR/risk``.
        draws: Parameter name to array (chain, draw), SI.
        flights: Run name to landing quantities, see `touchdown_table`; without it the landing files are left out.
        units: Unit of every parameter and landing quantity.
        bounds: Known limits of parameters [unit].
        effective: Independent draws by parameter (bulk ESS).
        thresholds: Thresholds of special interest by landing quantity [unit].
        independent: Independent landings per run, if fewer than the draws.

    Returns:
        The frames by file stem: draws, marginals, correlation, touchdown, exceedance, tolerance.
    """
    tables = {"draws": write_draws(draws, folder, units)}
    tables["marginals"] = marginal_table(tables["draws"], units, bounds, effective)
    tables["correlation"] = correlation_table(tables["draws"])
    if flights:
        tables["touchdown"] = write_touchdown(flights, folder, units)
        tables["exceedance"] = exceedance_table(tables["touchdown"], thresholds, 0.9, independent, units)
        tables["tolerance"] = tolerance_table(tables["touchdown"], TOLERANCES, independent, units)
    for stem in ("marginals", "correlation", "exceedance", "tolerance"):
        if stem in tables:
            _csv(tables[stem], folder / f"{stem}.csv", index=stem == "correlation")
    return tables
