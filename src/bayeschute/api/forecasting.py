"""Predictions of the flights of a file from a stored posterior: the command `bayeschute predict`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import xarray as xr

from bayeschute.api.flight import Flight
from bayeschute.api.posterior import Posterior, draws_held
from bayeschute.calibration.label import caveat
from bayeschute.core.files import write_whole
from bayeschute.core.netcdf_files import write_netcdf
from bayeschute.report.figures.canvas import save
from bayeschute.report.wording import quantity
from bayeschute.study.job import Progress, write_json
from bayeschute.study.load import load_flights


def predict_file(
    posterior: Path | str,
    flights: Path | str,
    folder: Path | str,
    draws: int | None = None,
    seed: int | None = None,
    data: Path | str | None = None,
    progress: Progress | None = None,
    like: str | None = None,
) -> list[str]:
    """Predict flights: ``predictions.nc``, ``requirements.json``, and a figure of bands for each.

    Args:
        posterior: From `Posterior.save`.
        flights: TOML with ``[[flight]]`` tables, see `load_flights`.
        folder: Where to.
        draws: Draws of each flight; the study's number where None.
        seed: Seed; the study's where None.
        data: Folder that replaces ``${DATA}``.
        progress: Called with stage, share done and words.
        like: As in `Posterior.predict`.

    Returns:
        Lines of the summary that the command prints.

    Raises:
        InputError: With every fault of the file, before anything is drawn.
    """
    asked, folder = Posterior.load(posterior), Path(folder)
    study = load_flights(flights, asked.spec, data)
    count = draws or min(study.predict.draws, draws_held(asked))
    bands, rows, lines, failed = {}, [], list[str](), dict[str, None]()
    for i, spec in enumerate(study.flights):
        if progress is not None:
            progress("predict", i / len(study.flights), spec.name)
        one = asked.predict(Flight.of_study(study, spec), count, seed, like=like)
        bands[f"/{spec.name}"] = one.to_dataset()
        save(one.plot(), folder, f"bands-{spec.name}")
        failed |= dict.fromkeys(one.failed_checks)
        lines += filter(None, [one.draws.attrs["lost"]])
        for name in one.quantities:
            unit, ends = one.draws[name].attrs["units"], one.statistic(name).quantile([0.05, 0.5, 0.95])
            low, middle, high = (quantity(float(end), unit, 4) for end in ends)
            lines.append(f"{spec.name}: mean {name} {middle}, central 90 % {low} to {high}")
        for wanted in study.requirements:
            met = one.probability(
                wanted.quantity, statistic=wanted.statistic, at_most=wanted.at_most, at_least=wanted.at_least
            )
            rows.append({"flight": spec.name, **wanted.model_dump(), **vars(met)})
            said = f"met in {100 * met.met:.1f} % of {met.draws} draws ({100 * met.low:.1f} to {100 * met.high:.1f} %)"
            lines.append(f"{spec.name}: {wanted.name} {said}")
    tree = xr.DataTree.from_dict(bands)
    write_whole(folder / "predictions.nc", partial(write_netcdf, tree))
    write_json(folder / "requirements.json", rows)
    if progress is not None:
        progress("predict", 1.0, f"{len(bands)} flights")
    return [*lines, caveat(tuple(failed), asked.trust.words)]
