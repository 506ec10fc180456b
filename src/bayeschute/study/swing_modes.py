"""Swing modes from a log (`bayeschute modes`): columns named on the command line in, a table or JSON out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bayeschute.core.errors import Fault, InputError
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import LABELS, VARIABLES
from bayeschute.swing.hanging_swing import HangingSwing, hanging_swing
from bayeschute.swing.modal import Halves, amplitude_effect, compare_halves

_FORM = "QUANTITY=COLUMN:UNIT"
_EXAMPLE = "For example --column 'time=t:s' --column 'capsule_rate=gyro_*:deg/s', where * stands for x, y and z."
_QUANTITIES = (  # of the fit, unit, factor to it
    ("frequency", "Hz", 1.0),
    ("period", "s", 1.0),
    ("damping_ratio", "1", 1.0),
    ("decay_rate", "1/s", 1.0),
    ("amplitude", "deg", float(np.rad2deg(1.0))),
)


class Modes(NamedTuple):
    """Swing modes found in a log.

    Attributes:
        path: The log.
        swing: Window, motion and fit.
        halves: The fit's halves apart; None where they are too short.
        reason: Why they are not compared; empty where they are.
    """

    path: Path
    swing: HangingSwing
    halves: Halves | None
    reason: str


def columns_of(texts: Sequence[str]) -> dict[str, ColumnSpec]:
    """Column map from texts like ``capsule_rate.x=gyro_x:deg/s``.

    A quantity of several components may be given at once, with ``*`` in the column's name for the component:
    ``capsule_rate=gyro_*:deg/s``. The unit follows the last colon.

    Args:
        texts: One per column.

    Returns:
        As `bayeschute.records.read.read_record` takes it.

    Raises:
        InputError: For every text of another form, and quantities given twice.
    """
    columns: dict[str, ColumnSpec] = {}
    faults = []
    for text in texts:
        where = f"--column {text}"
        quantity, equals, rest = text.partition("=")
        column, colon, unit = rest.rpartition(":")
        quantity, column = quantity.strip(), column.strip()
        if not (equals and colon and quantity and column):
            faults.append(Fault(where, "another form", _FORM, _EXAMPLE))
            continue
        variable = VARIABLES.get(quantity)
        labels = [label for d in variable.dims if d in LABELS for label in LABELS[d]] if variable else []
        parts = {f"{quantity}.{label}": label for label in labels} if "*" in column and labels else {quantity: "*"}
        for key, label in parts.items():
            if key in columns:
                faults.append(Fault(where, f"{key} again", "every quantity once"))
            columns[key] = ColumnSpec(column.replace("*", label), unit.strip())
    if faults:
        raise InputError(faults)
    return columns


def find_modes(
    path: Path | str,
    columns: Sequence[str] = (),
    window: tuple[float, float] | None = None,
    band: tuple[float, float] | None = None,
    forcing: bool = True,
    seed: int = 0,
) -> Modes:
    """Frequency and damping of a body's swing from its log.

    Args:
        path: ``.csv``, ``.csv.gz``, ``.parquet`` or ``.nc``.
        columns: See `columns_of`; none for ``.nc``, whose variables are named.
        window: First and last time of the descent [s]; found where none is given.
        band: Where to look for the swing [Hz]; None: everywhere the record allows.
        forcing: Whether gusts may drive the swing.
        seed: Of the draws.

    Returns:
        The swing, and its halves where they are long enough.

    Raises:
        InputError: With every fault of the columns and the log; if no descent is found or it is too short.
    """
    path, specs = Path(path), columns_of(columns)
    if path.suffix.lower() != ".nc" and "time" not in specs:
        raise InputError(Fault("--column", "no column for time", _FORM, _EXAMPLE))
    if window is not None and not (np.isfinite(window).all() and window[0] < window[1]):
        raise InputError(Fault("--window", f"{window[0]:g} to {window[1]:g} s", "a start before an end [s]"))
    try:
        record = read_record(path, specs or None, window)
    except InputError as error:
        raise InputError([replace(f, where=_as_option(f.where)) for f in error.faults]) from error
    swing = hanging_swing(record, window, band=band, forcing=forcing, seed=seed)
    try:
        return Modes(path, swing, compare_halves(swing.fit, seed), "")
    except InputError as error:
        return Modes(path, swing, None, str(error))


def _as_option(where: str) -> str:
    """A place in a study's column map, as an option of the command line."""
    return where.replace("[columns.", "--column ").replace("[columns]", "--column").replace("]", "")


def document(modes: Modes) -> dict[str, Any]:
    """The result as plain values.

    Args:
        modes: As found.

    Returns:
        ``window`` and ``fitted`` [s], quantities with mean, sd and 90 % limits, the halves, and whether to trust it.
    """
    swing, fit = modes.swing, modes.swing.fit
    content: dict[str, Any] = {
        "record": str(modes.path),
        "window": [swing.window.start, swing.window.end],
        "fitted": [swing.window.start + fit.start, swing.window.end],
        "descent_rate": swing.window.descent_rate if np.isfinite(swing.window.descent_rate) else None,
        "cycles": fit.cycles,
        "forcing": fit.problem.forcing,
        "effective_draws": fit.ess,
        "trusted": fit.trusted,
        "level": 0.9,
        "quantities": {
            name: {"unit": unit, **{k: factor * v for k, v in getattr(fit, name)._asdict().items()}}
            for name, unit, factor in _QUANTITIES
        },
        "amplitude_effect": amplitude_effect(fit.amplitude.mean)[0],
        "spin": float(np.mean(np.abs(swing.motion.spin))) / (2.0 * np.pi),
        "halves": {"compared": modes.halves is not None, "reason": modes.reason},
    }
    if modes.halves is not None:
        halves = modes.halves
        content["halves"] |= {
            "frequency": [halves.first.frequency.mean, halves.second.frequency.mean],
            "frequency_change": halves.frequency_change._asdict(),
            "damping_change": halves.damping_change._asdict(),
        }
    return content


def lines(modes: Modes) -> list[str]:
    """The table for the terminal."""
    content = document(modes)
    (start, end), fitted = content["window"], content["fitted"]
    rate = "" if content["descent_rate"] is None else f" at {content['descent_rate']:.1f} m/s"
    spin = f"spin {content['spin']:.2f} turns/s on average"
    out = [
        f"{modes.path.name}: descent{rate} from {start:.1f} to {end:.1f} s; {spin}",
        f"fitted from {fitted[0]:.1f} s: {content['cycles']:.1f} cycles of a damped swing"
        + (
            " excited by gusts"
            if content["forcing"]
            else ", without gust excitation: intervals too narrow in moving air"
        ),
        f"{'':14} {'mean':>9} {'sd':>9} {'5 %':>9} {'95 %':>9}  unit",
    ]
    for name, q in content["quantities"].items():
        values = " ".join(f"{q[k]:>9.4f}" for k in ("mean", "sd", "low", "high"))
        out.append(f"{name.replace('_', ' '):14} {values}  {'' if q['unit'] == '1' else q['unit']}".rstrip())
    effect = -100.0 * content["amplitude_effect"]
    out.append(f"The finite initial amplitude lowers the frequency of a pendulum by {effect:.2f} %.")
    halves = content["halves"]
    if halves["compared"]:
        change, damping = halves["frequency_change"], halves["damping_change"]
        out.append(
            f"Second half minus first half: {change['mean']:+.4f} Hz ({change['low']:+.4f} to {change['high']:+.4f}), "
            f"damping ratio {damping['mean']:+.4f} ({damping['low']:+.4f} to {damping['high']:+.4f}); "
            f"{_verdict(change)}"
        )
    else:
        out.append(f"The halves of the record are not compared: {halves['reason']}")
    if not content["trusted"]:
        out.append(f"Not reliable: the effective sample size is only {content['effective_draws']:.0f}.")
    return out


def _verdict(change: dict[str, float]) -> str:
    if change["low"] <= 0.0 <= change["high"]:
        return "no significant change of frequency."
    return "the frequency changed significantly, so one value for the whole record is misleading."
