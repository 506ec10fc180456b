"""HTML tables for notebooks: escaped text, without styles."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[object]], note: str = "") -> str:
    """An HTML table with a title and a note."""
    cells = "".join(f'<th scope="col">{escape(one)}</th>' for one in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(one))}</td>" for one in row) + "</tr>" for row in rows)
    below = f"<p>{escape(note)}</p>" if note else ""
    return (
        f"<div><b>{escape(title)}</b><table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>{below}</div>"
    )


def number(value: float) -> str:
    """A number to four digits."""
    return f"{value:.4g}"


def summary(title: str, of: str, rows: pd.DataFrame) -> str:
    """An HTML table of a frame with median, 90 % interval (low, high) and unit by quantity."""
    told = [
        (name, number(row["median"]), f"{number(row['low'])} to {number(row['high'])}", row["unit"])
        for name, row in rows.iterrows()
    ]
    return table(title, (of, "median", "central 90 %", "unit"), told)
