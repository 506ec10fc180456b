"""Do two versions of the numerics give the same results? Finished runs of the same studies, compared.

    bayeschute run STUDY --out BEFORE       # with the earlier code
    bayeschute run STUDY --out AFTER        # with the present code
    python benchmarks/compare_numerics.py --made-at COMMIT BEFORE AFTER [BEFORE AFTER ...] [--json]

``--made-at`` is the commit whose code made the earlier runs. The result is kept in ``models/reference/numerics``, named
after both hashes. Of a configuration of which three studies or more are the same by
`study.evidence.numerics_compared`, results that the earlier numerics have stored count for the present ones. Where the
runs are of three configurations or more and the same but for rounding (code that was only written differently; small
runs with ``--quick`` will do), all do.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import xarray as xr
from command import parser_of
from numpy.typing import NDArray
from other_stored import ROOT, numerics_at

from bayeschute.study.evidence.identity import configuration
from bayeschute.study.evidence.numerics_compared import BOUNDS, STORED, Comparison, Figures
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.provenance import provenance
from bayeschute.study.load import load_study

Array = NDArray[np.float64]


def main() -> None:
    """Compare, store, print a table; with ``--json`` the comparison as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("runs", nargs="+", type=Path, help="folders of runs, before and after by turns")
    parser.add_argument("--made-at", required=True, metavar="COMMIT", help="that made the earlier runs")
    parser.add_argument("--store", type=Path, default=ROOT / "models" / STORED, metavar="DIR")
    given = parser.parse_args()
    if len(given.runs) % 2:
        parser.error(f"{len(given.runs)} folders of runs; wanted: pairs of one before and one after")
    before, commit = numerics_at(given.made_at)
    rows = tuple(compared(*pair) for pair in zip(given.runs[::2], given.runs[1::2], strict=True))
    told = provenance(f"benchmarks/compare_numerics.py --made-at {commit[:7]} BEFORE AFTER ...")
    made = Comparison(before=before, after=numerics(), studies=rows, provenance=told)
    given.store.mkdir(parents=True, exist_ok=True)
    path = given.store / f"{before[:8]}-{made.after[:8]}.json"
    path.write_text(json.dumps(made.model_dump(mode="json"), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{'study':40s} {'mean':>7s} {'sd':>7s} {'band':>7s} {'width':>7s} {'fit, s':>15s}")
    for row in rows:
        figures = " ".join(f"{getattr(row, name):7.3f}" for name in BOUNDS._fields)
        print(f"{row.study[:40]:40s} {figures} {row.seconds[0]:6.0f} -> {row.seconds[1]:5.0f}")
    print(f"{'bounds':40s} {' '.join(f'{bound:7.3f}' for bound in BOUNDS)}")
    print(f"all configurations: {'identical' if made.identical else 'not identical, or too few kinds'}")
    for name in sorted({row.configuration for row in rows}):
        print(f"configuration {name[:8]}: {'the same' if made.same(name) else 'not the same, or too few studies'}")
    if given.json:
        print(made.model_dump_json())


def compared(before: Path, after: Path) -> Figures:
    """Differences of two finished runs of a study.

    Args:
        before: Folder of one.
        after: Of the other.
    """
    one, other = (json.loads((run / "summary.json").read_text(encoding="utf-8")) for run in (before, after))
    if one["hashes"]["study"] != other["hashes"]["study"]:
        raise SystemExit(f"{before} and {after} are runs of different studies, or their inputs differ")
    means, sds = [], []
    if set(one["parameters"]) != set(other["parameters"]):
        raise SystemExit(f"{before} and {after} have chosen different terms: their results are not the same")
    for name, first in one["parameters"].items():
        second = other["parameters"][name]
        means.append(abs(second["mean"] - first["mean"]) / first["sd"])
        sds.append(abs(np.log(second["sd"] / first["sd"])))
    differ = [_bands(a, b) for a, b in _quantiles(before, after)]
    seconds = tuple(float(run["sampling"]["wall"]["fit_s"]) for run in (one, other))
    return Figures(
        study=one["title"], hash=one["hashes"]["study"],
        configuration=configuration(load_study(before / "study.toml"), bool(one["quick"])),
        mean=max(means), sd=max(sds), band=max((band for band, _ in differ), default=0.0),
        width=max((width for _, width in differ), default=0.0), seconds=(seconds[0], seconds[1]),
    )  # fmt: skip


def _quantiles(before: Path, after: Path) -> list[tuple[Array, Array]]:
    """The 5 and 95 % limits (2, T) of every predicted flight and quantity, by both."""
    found = []
    with xr.open_datatree(before / "predictions.nc") as one, xr.open_datatree(after / "predictions.nc") as other:
        for flight, node in one.children.items():
            if node.attrs["role"] != "predict":
                continue
            for name, series in node.data_vars.items():
                if set(series.dims) == {"quantile", "time"}:
                    pair = (one[str(flight)][str(name)], other[str(flight)][str(name)])
                    limits = [band.sel(quantile=[0.05, 0.95]).transpose("quantile", "time") for band in pair]
                    found.append((limits[0].to_numpy(), limits[1].to_numpy()))
    return found


def _bands(one: Array, other: Array) -> tuple[float, float]:
    """Root mean square difference of limits over the mean width, and the logarithm of the ratio of mean widths."""
    known = np.isfinite(one).all(axis=0) & np.isfinite(other).all(axis=0)
    first, second = (float(np.mean(band[1, known] - band[0, known])) for band in (one, other))
    return float(np.sqrt(np.mean((other - one)[:, known] ** 2))) / first, abs(float(np.log(second / first)))


if __name__ == "__main__":
    main()
