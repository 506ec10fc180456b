"""Files of the risk assessment: draws, marginals, correlations, end of record, exceedance, tolerance limits.

Two kinds of uncertainty are kept separate throughout: posterior uncertainty (in the probability of meeting a
requirement) and Monte Carlo error of the finite number of simulated flights (Clopper-Pearson and Jeffreys limits,
Wilks' order statistics). A flight whose simulation failed is never dropped: it counts as exceeding every limit, and a
column gives the number of failures. ``data_dictionary.csv`` describes every column.
"""

from __future__ import annotations

import json
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
from bayeschute.prediction.data_dictionary import data_dictionary
from bayeschute.prediction.exceedance import TOLERANCES, Widened, exceedance_table, samples_table, tolerance_table
from bayeschute.prediction.flight_statistics import UNITS
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
    "samples_table",
    "tolerance_table",
    "wilks_sample_size",
    "write_draws",
    "write_risk",
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
    """Write draws.parquet (units in the metadata), draws.csv and draws_units.csv.

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
        family (fit_q00135, fit_q99865: the draws alone carry little information there), the criterion (aic, and
        runner_up, the best of the others, with its aic), ks_distance, draws, independent_draws.
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


def write_risk(
    folder: Path,
    draws: Mapping[str, ArrayLike],
    flights: Mapping[str, Mapping[str, Mapping[str, ArrayLike]]] | None = None,
    units: Mapping[str, str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    effective: Mapping[str, float] | None = None,
    requirements: Sequence[Mapping[str, Any]] = (),
    independent: float | None = None,
    widened: Widened | None = None,
) -> dict[str, pd.DataFrame]:
    """Write every file of the risk folder, and the dictionary of their columns.

    Args:
        folder: Usually ``DIR/risk``.
        draws: Parameter name to array (chain, draw), SI.
        flights: Run name to statistic to quantity to values (draw,), see `flight_statistics`; without it the files of
            flights are left out.
        units: Unit of every parameter, and of every quantity that is not in `flight_statistics.UNITS`.
        bounds: Known limits of parameters [unit].
        effective: Independent draws by parameter (bulk ESS).
        requirements: Rows of `requirement_check`; their limits are among the thresholds of their statistic.
        independent: Independent draws per run, if fewer than the draws.
        widened: Factors by which the draws of flights were widened before.

    Returns:
        The frames by file stem: draws, marginals, correlation, end_of_record, exceedance, tolerance.
    """
    units = UNITS | dict(units or {})
    tables = {"draws": write_draws(draws, folder, units)}
    tables["marginals"] = marginal_table(tables["draws"], units, bounds, effective)
    tables["correlation"] = correlation_table(tables["draws"])
    if flights:
        tables |= _flight_tables(flights, requirements, independent, units, widened)
        _parquet(tables["end_of_record"], folder / "end_of_record.parquet", units)
    for stem in ("marginals", "correlation", "exceedance", "tolerance"):
        if stem in tables:
            _csv(tables[stem], folder / f"{stem}.csv", index=stem == "correlation")
    write_whole(folder / "requirements.json", lambda path: path.write_text(json.dumps(list(requirements), indent=1)))
    _csv(_dictionary(tables, requirements, units), folder / "data_dictionary.csv")
    return tables


def _flight_tables(
    flights: Mapping[str, Mapping[str, Mapping[str, ArrayLike]]],
    requirements: Sequence[Mapping[str, Any]],
    independent: float | None,
    units: Mapping[str, str],
    widened: Widened | None,
) -> dict[str, pd.DataFrame]:
    """End of record, exceedance and tolerance of the statistics of flights, see `write_risk`."""
    made: dict[str, list[pd.DataFrame]] = {"exceedance": [], "tolerance": []}
    found: dict[str, pd.DataFrame] = {}
    for statistic in dict.fromkeys(name for tables in flights.values() for name in tables):
        samples = samples_table({run: tables[statistic] for run, tables in flights.items() if statistic in tables})
        if statistic == "final":
            found["end_of_record"] = samples
        limits: dict[str, list[float]] = {}
        for row in requirements:
            if row["statistic"] == statistic:
                limit = row["at_most"] if row["at_most"] is not None else row["at_least"]
                limits.setdefault(row["quantity"], []).append(limit)
        exceeded = exceedance_table(samples, statistic, limits, 0.9, independent, units, widened)
        made["exceedance"].append(exceeded)
        made["tolerance"].append(tolerance_table(samples, statistic, TOLERANCES, independent, units, widened))
    return found | {stem: pd.concat(tables, ignore_index=True) for stem, tables in made.items()}


def _dictionary(
    tables: Mapping[str, pd.DataFrame], requirements: Sequence[Mapping[str, Any]], units: Mapping[str, str]
) -> pd.DataFrame:
    """Description of every column of the files of these tables."""
    columns = {stem: [str(name) for name in table.columns] for stem, table in tables.items()}
    files = {f"{stem}.{'parquet' if stem == 'end_of_record' else 'csv'}": names for stem, names in columns.items()}
    files = {"draws.parquet": columns["draws"], "draws_units.csv": ["column", "unit"]} | files
    files["correlation.csv"] = ["parameter", *columns["correlation"]]
    return data_dictionary(files | {"requirements.json": list(requirements[0]) if requirements else []}, units)
