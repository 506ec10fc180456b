"""Plausibility of records before any fit, on one self-contained page: broken laws and compared channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path

import xarray as xr

from bayeschute.core.files import write_whole
from bayeschute.records.plausibility.verdict import Finding, Verdict
from bayeschute.report.figures.canvas import data_uri, svg_of
from bayeschute.report.figures.plausibility_figures import plausibility_figure

_STYLE = """
body { margin: 2.5rem auto; max-width: 62rem; padding: 0 1.5rem; color: #1f2933;
  font: 1rem/1.5 "Segoe UI", "Helvetica Neue", Arial, sans-serif; }
h2 { margin-top: 2.5rem; border-top: 2px solid #1f2933; padding-top: .7rem; }
table { border-collapse: collapse; font-size: .9rem; } th, td { text-align: left; padding: .25rem .8rem .25rem 0;
  border-bottom: 1px solid #dfe4e8; vertical-align: top; }
.fault { color: #a83a00; font-weight: 600; } .warning { color: #7a5900; font-weight: 600; }
img { width: 100%; } .cause { padding: .5rem .9rem; border-left: 5px solid #a83a00; background: #fdf1eb; }
"""


def _row(one: Finding) -> str:
    cells = (one.law, one.tests, one.got, one.wanted, one.severity, "; or: ".join(one.causes), one.do)
    marked = "".join(f'<td class="{one.severity if c == one.severity else ""}">{escape(c)}</td>' for c in cells)
    return f"<tr>{marked}</tr>"


def _picture(verdict: Verdict, window: tuple[float, float] | None, record: xr.Dataset | None) -> str:
    uri = data_uri(svg_of(plausibility_figure(verdict, window, record)))
    return f'<img alt="Channels of the record, and how far each law is from its limit" src="{uri}">'


def _flight(
    name: str, verdict: Verdict, window: tuple[float, float] | None, said: str, record: xr.Dataset | None
) -> str:
    out = [f"<h2>{escape(name)}</h2>", f"<p>{escape(said)}</p>" if said else ""]
    out += [f'<p class="cause">Likely cause: {escape(cause)}</p>' for cause in verdict.causes]
    if verdict.findings:
        head = "".join(f"<th>{c}</th>" for c in ("law", "compares", "got", "wanted", "", "likely causes", "what to do"))
        out.append(f"<table><tr>{head}</tr>{''.join(map(_row, verdict.findings))}</table>")
    else:
        out.append(f"<p>All {len(verdict.readings)} laws that could be tried are kept.</p>")
    return "".join([*out, _picture(verdict, window, record)])


def write_record_page(
    path: Path,
    title: str,
    verdicts: Mapping[str, Verdict],
    faults: Sequence[str] = (),
    windows: Mapping[str, tuple[float, float]] = {},
    said: Mapping[str, str] = {},
    records: Mapping[str, xr.Dataset] = {},
) -> Path:
    """Write the page.

    Args:
        path: Where to.
        title: Of the study.
        verdicts: What the laws say, by flight.
        faults: Every fault of the study, as text.
        windows: First and last time used, by flight [s].
        said: A sentence on the window, by flight.
        records: As read, by flight; of one that is missing, the times used are drawn.
    """
    listed = "".join(f'<li class="fault">{escape(one)}</li>' for one in faults)
    body = "".join(
        _flight(name, one, windows.get(name), said.get(name, ""), records.get(name)) for name, one in verdicts.items()
    )
    text = (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body><h1>Records of {escape(title)}</h1>"
        f"<p>Records as read, before any fit.</p><ul>{listed}</ul>"
        f"{body or '<p>No record could be read.</p>'}</body></html>\n"
    )
    write_whole(path, partial(Path.write_text, data=text, encoding="utf-8"))
    return path
