"""HTML report of a run: one self-contained file with tables, figures and text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure

from bayeschute.core.files import write_whole
from bayeschute.report import failed_fit, first_screen, sentences
from bayeschute.report.figures import curve_figures, inference_figures, predictive_figures, record_figures
from bayeschute.report.figures.canvas import data_uri, save
from bayeschute.report.run_results import Results, entries, mappings, read_results
from bayeschute.report.structure_view import Draw, structure_view
from bayeschute.report.tables import (
    curve_tables,
    identifiability_tables,
    predictive_tables,
    record_tables,
    summary_tables,
    trust_tables,
)
from bayeschute.report.wording import counted, is_number, listed, number, percent, quantity_name, statistic_name


class Picture(NamedTuple):
    """A figure in the report: data URI, text for those who can't see it, and caption."""

    uri: str
    alt: str
    caption: str


def _picture(figure: Figure, folder: Path, name: str, alt: str, caption: str) -> Picture:
    """Save a figure and inline it."""
    svg = save(figure, folder, name)
    return Picture(data_uri(svg.read_text(encoding="utf-8")), alt, caption)


def _slug(name: str) -> str:
    """A name that is safe in a file name."""
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name)


def _limits(results: Results) -> dict[tuple[str, str], list[float]]:
    """Limits of the requirements (SI), by the quantity and the statistic that they are set on."""
    found: dict[tuple[str, str], list[float]] = {}
    for requirement in sentences.requirements(results):
        for limit in (requirement.get("at_most"), requirement.get("at_least")):
            if is_number(limit):
                key = (str(requirement.get("quantity")), str(requirement.get("statistic")))
                found[key] = sorted({*found.get(key, []), float(limit)})
    return found


def _limits_at_every_time(results: Results) -> dict[str, float]:
    """The least upper limit (SI) on the maximum of each quantity: the one kind that holds at every time of a band."""
    found: dict[str, float] = {}
    for requirement in sentences.requirements(results):
        limit, name = requirement.get("at_most"), str(requirement.get("quantity"))
        if requirement.get("statistic") == "maximum" and is_number(limit):
            found[name] = min(float(limit), found.get(name, np.inf))
    return found


def _record_pictures(results: Results, folder: Path) -> list[Picture]:
    """One figure per record."""
    found = []
    facts = entries(results.part("flights"))
    for name, record in results.flights.items():
        repairs = record_tables.faults_of(mappings(facts.get(name, {}).get("repairs")))
        figure = record_figures.record_figure(record, repairs)
        if figure.axes:
            alt = f"Altitude, descent rate and wind of {name} over time; {counted(len(repairs), 'fault')} marked."
            caption = f"{name}: the record as it was used. Purple: samples that were missing, faulty or excluded."
            found.append(_picture(figure, folder, f"record-{_slug(name)}", alt, caption))
    return found


def _band_pictures(results: Results, folder: Path) -> list[Picture]:
    """One figure of bands per flight."""
    found = []
    for name, bands in results.predictions.items():
        quantities = record_figures.band_quantities(bands)
        if not quantities:
            continue
        shares = [(q, record_figures.coverage(bands, q, 0.05, 0.95)) for q in quantities]
        scored = [f"{percent(s)} of the {quantity_name(q)}" for q, s in shares if s is not None]
        alt = f"Predicted bands of {listed([quantity_name(q) for q in quantities])} on {name} over time."
        alt += f" The 90 % band contains {listed(scored)}." if scored else ""
        role = bands.attrs.get("role")
        seen = {"predict": "not used in the fit", "identify": "used in the fit"}.get(str(role), "")
        caption = f"{name}{', ' + seen if seen else ''}: median, 50 % and 90 % bands of the posterior predictive "
        caption += "distribution (parameters, disturbances and initial state)."
        figure = record_figures.band_figure(bands, _limits_at_every_time(results))
        found.append(_picture(figure, folder, f"bands-{_slug(name)}", alt, caption))
    return found


def _variance_picture(results: Results, folder: Path) -> Picture | None:
    """Shares of variance of all flights."""
    shares: dict[str, xr.DataArray] = {
        name: bands["variance_share"]
        for name, bands in results.predictions.items()
        if "variance_share" in bands and {"source", "quantity"} == set(bands["variance_share"].dims)
    }
    if not shares:
        return None
    caption = (
        "Variance decomposition of the predictions: the share of the variance that would vanish if a source were known."
    )
    return _picture(
        record_figures.variance_figure(shares),
        folder,
        "variance",
        f"Stacked bars: shares of variance by source for {listed(list(shares))}.",
        caption,
    )


def _autocorrelations(results: Results) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Curves of residual autocorrelation that the run left, by name."""
    found = {}
    for name, facts in entries(results.structure.get("coefficients")).items():
        residual = facts.get("residual")
        if isinstance(residual, Mapping):
            value, lag = (np.array(residual[key], dtype=float) for key in ("autocorrelation", "lag"))
            if value.size > 1 and np.isfinite(value).all():
                found[f"{name} force, structure"] = (lag, value)
    return found


def _posterior_pictures(results: Results, folder: Path) -> tuple[list[Picture], list[Picture]]:
    """Figures of the posterior, and those of the chains."""
    parameters = results.part("parameters")
    names = [n for n in parameters if n in results.posterior] or list(results.posterior)
    draws = {n: results.posterior[n] for n in names if np.isfinite(results.posterior[n]).all()}
    if not draws:
        return [], []
    facts = entries(parameters)
    units = {n: str(facts.get(n, {}).get("unit") or "1") for n in draws}
    truth = {n: float(facts[n]["truth"]) for n in draws if n in facts and is_number(facts[n].get("truth"))}
    most = inference_figures.MOST_PANELS
    more = f" The first {most} of {len(draws)} parameters." if len(draws) > most else ""
    caption = "Marginal prior (grey, dashed) and posterior (blue) densities; the true value where it is known."
    figure = inference_figures.marginal_figure(draws, results.prior, truth, units)
    alt = f"Prior and posterior densities of {counted(len(draws), 'parameter')}."
    found = [_picture(figure, folder, "marginals", alt, caption + more)]
    varied = [n for n in draws if draws[n].std() > 0][:24]
    if len(varied) > 1:
        matrix = np.corrcoef(np.stack([draws[n].ravel() for n in varied]))
        i, j = np.unravel_index(np.argmax(np.abs(np.tril(matrix, -1))), matrix.shape)
        strongest = f"The strongest is {number(float(matrix[i, j]), 2)}, between {varied[i]} and {varied[j]}."
        figure = inference_figures.correlation_figure(varied, matrix)
        caption = f"Pairwise posterior correlations. Where they are strong, use joint draws. {strongest}"
        found.append(_picture(figure, folder, "correlation", f"Heat map of correlations. {strongest}", caption))
    caption = "Trace plots, and rank histograms of each chain relative to the uniform distribution (grey: 99 % range "
    caption += "for independent draws). Chains that have converged look alike."
    alt = f"Traces and rank histograms of {counted(len(draws), 'parameter')}."
    chains = [_picture(inference_figures.chain_figure(draws, units), folder, "chains", alt, caption + more)]
    return found, chains


def _curve_picture(results: Results, folder: Path) -> Picture | None:
    """The aerodynamic curves, with what others know of them."""
    table, told = results.curves, results.part("curves")
    needed = {"curve", "symbol", "unit", "at", "flown", "posterior_q05", "posterior_q50", "posterior_q95"}
    if table is None or not needed <= set(table.columns):
        return None
    known = mappings(results.summary.get("knowledge"))
    names = list(dict.fromkeys(table["curve"]))
    words = {str(k): str(v) for k, v in (told.get("words") or {}).items()}
    caption = (
        "Force coefficients of a canopy alone, at its reference speed: medians and 90 % bands before and after the "
    )
    caption += (
        "records were used, over the range that was flown (central 99 %); dotted beyond it, where the form of the "
    )
    caption += "terms speaks and no data do. In curves.csv."
    alt = f"Curves of {listed(names)} with prior and posterior bands."
    figure = curve_figures.curve_figure(table, known, words, told.get("flown") or {})
    return _picture(figure, folder, "curves", alt, caption)


def _aerodynamics(results: Results, folder: Path) -> dict[str, Any]:
    """Curves, what others know of them, and terms that are proposed."""
    return {
        "picture": _curve_picture(results, folder),
        "sentences": curve_tables.knowledge_sentences(results),
        "known": curve_tables.knowledge_table(results),
        "proposal": curve_tables.proposal_sentence(results),
        "proposals": curve_tables.proposal_table(results),
    }


def _exceedance_picture(results: Results, folder: Path) -> Picture | None:
    """Exceedance probabilities of the statistics that requirements refer to, and of at least two common ones."""
    needed = ("run", "quantity", "statistic", "unit", "threshold", "probability", "draws")
    table = results.table("exceedance", *needed, "clopper_pearson_low", "clopper_pearson_high")
    if table is None:
        return None
    limits = _limits(results)
    shown = trust_tables.shown_statistics(results, table)
    shown = shown.head(max(len(limits), 2))
    if shown.empty:
        return None
    table = shown.merge(table)
    names = listed([statistic_name(q, s) for q, s in zip(shown["quantity"], shown["statistic"], strict=True)])
    return _picture(
        record_figures.exceedance_figure(table, limits),
        folder,
        "exceedance",
        f"Probability of exceeding a threshold, for {names}.",
        "Probability that a flight exceeds a threshold; shaded: 90 % Clopper-Pearson limits (Monte Carlo error). A "
        "required limit is drawn only where the requirement refers to that statistic.",
    )


def _predictive_picture(results: Results, folder: Path) -> Picture | None:
    """p-values of the predictive checks, and PIT histograms."""
    checks, pit = predictive_tables.predictive_checks(results), results.part("predictive").get("pit")
    if not checks or not isinstance(pit, Mapping):
        return None
    return _picture(
        predictive_figures.predictive_figure(checks, pit, predictive_tables.predictive_bound(results)),
        folder,
        "predictive",
        "p-values of the posterior predictive checks by statistic, and PIT histograms of the innovations by channel.",
        "Posterior predictive checks of the fitted records. Grey beyond the bound: an error that is there and moves no "
        "parameter. Right: probability integral transform of the innovations "
        "given all earlier samples, which is uniform under the model; shaded: 90 % range of each bin.",
    )


def _widened(results: Results) -> str:
    """Whether the risk numbers are of recalibrated (widened) draws, in a sentence; empty where they are not."""
    table = results.table("exceedance", "run", "widened_by")
    if table is None or not (table["widened_by"] != 1.0).any():
        return ""
    flights = [str(name) for name in dict.fromkeys(table["run"][table["widened_by"] != 1.0])]
    return (
        f"Draws of {listed(flights)} are recalibrated as their bands are: widened about their median by the factors in "
        "risk/exceedance.csv (widened_by)."
    )


def _of_every_run(results: Results, draw: Draw) -> dict[str, Any]:
    """What the template shows of any run: input data, structure, provenance."""
    summary = results.summary
    notes = summary.get("notes")
    return {
        "title": str(summary.get("title") or "Parachute identification"),
        "heading": re.sub(r"(?<=\w)-(?=\w)", "\u2011", str(summary.get("title") or "Parachute identification")),
        "model": summary.get("model"),
        "quick": summary.get("quick") is True,
        "label": sentences.label(results),
        "has_level": sentences.has_level(results),
        "claim": sentences.claim_sentences(results),
        "flights": record_tables.flight_table(results),
        "repairs": record_tables.repair_table(results),
        "preparation": record_tables.preparation_table(results),
        "noise": summary_tables.noise_table(results),
        "latent": summary.get("noise_model", "latent") == "latent",
        "vehicle": summary.get("vehicle"),
        "records": _record_pictures(results, results.folder / "figures"),
        "structure": structure_view(results, draw),
        "notes": [str(n) for n in notes] if isinstance(notes, list) else [],
        "absent": results.absent,
        "seed": summary.get("seed"),
        "provenance": trust_tables.provenance_tables(results),
    }


def _context(results: Results) -> dict[str, Any]:
    """Everything that the template shows."""
    folder = results.folder / "figures"

    def draw(figure: Figure, *words: str) -> Picture:
        return _picture(figure, folder, *words)

    every = _of_every_run(results, draw)
    if failed_fit.is_failed(results):
        failed = failed_fit.view(results, draw)
        return every | {"failed": failed, "answers": [], "key": failed_fit.key_sentences(results), "warnings": []}
    half = {
        (flight, name): share
        for flight, bands in results.predictions.items()
        for name in record_figures.band_quantities(bands)
        if (share := record_figures.coverage(bands, name, 0.25, 0.75)) is not None
    }
    posterior, chains = _posterior_pictures(results, folder)
    curves = _autocorrelations(results)
    if curves:
        caption = (
            "Autocorrelation of the residuals. Where it decays slowly, standard errors for white residuals are too "
            "small."
        )
        alt = f"Residual autocorrelation of {listed(list(curves))}."
        chains.append(_picture(inference_figures.autocorrelation_figure(curves), folder, "residuals", alt, caption))
    return every | {
        "failed": None,
        "answers": first_screen.answers(results),
        "key": sentences.key_sentences(results),
        "warnings": trust_tables.warnings_of(results),
        "output_error": summary_tables.output_error_table(results),
        "posterior": summary_tables.posterior_table(results),
        "posterior_pictures": posterior,
        "aerodynamics": _aerodynamics(results, folder),
        "identifiability": {
            "sentences": identifiability_tables.identifiability_sentences(results),
            "parameters": identifiability_tables.identifiability_table(results),
            "directions": identifiability_tables.direction_table(results),
            "taught": curve_tables.taught_table(results),
        },
        "bands": _band_pictures(results, folder),
        "coverage": trust_tables.coverage_table(results, half),
        "variance": _variance_picture(results, folder),
        "checks": trust_tables.check_table(results),
        "predictive": predictive_tables.predictive_table(results),
        "possible_errors": predictive_tables.error_table(results),
        "predictive_picture": _predictive_picture(results, folder),
        "sampling": trust_tables.sampling_table(results),
        "chains": chains,
        "requirements": trust_tables.requirement_table(results),
        "exceedance": _exceedance_picture(results, folder),
        "widened": _widened(results),
        "tolerance": trust_tables.tolerance_report(results),
        "marginals": trust_tables.marginal_report(results),
    }


def build_report(run_dir: str | Path) -> Path:
    """Write figures and ``report.html`` from the results of a run, or of a run whose fit failed.

    Args:
        run_dir: Folder that `bayeschute run` wrote; only summary.json must be there.

    Returns:
        The path of the report: one file with its pictures inside, which needs no network.

    Raises:
        InputError: If summary.json is missing or is no JSON object.
    """
    results = read_results(Path(run_dir))
    text = resources.files("bayeschute.report").joinpath("template.html.j2").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page = environment.from_string(text).render(_context(results))
    path = results.folder / "report.html"
    write_whole(path, partial(Path.write_text, data=page, encoding="utf-8"))
    return path
