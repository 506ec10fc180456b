"""Which body axes a record was written in, told by the record itself: the text of `body_axes` that mends it.

A turn of attitude, angular rate and specific force together breaks no law between them; the vehicle tells it. At rest
the specific force points from the centre of mass to the attach point, which leaves the turns about that direction; a
centre of mass off the axis tells these apart, and Euler's equations, I dw/dt + w x I w = r x m f with the risers' pull
m f at the attach point r, have to agree. Where gyros and accelerometers don't go with the attitude, the signed columns
that do are sought first; where an axis that hardly moves leaves several, nothing is told. Only turns that put axes onto
axes are tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np

from bayeschute.records.foreign.attitudes import of_matrix
from bayeschute.records.foreign.attitudes import product as quaternion_product
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.plausibility.evidence import Array, Evidence, boxcar, slope, typical
from bayeschute.records.plausibility.motion_laws import attitude, specific_force
from bayeschute.records.plausibility.reading import FAULT, Reading
from bayeschute.records.plausibility.verdict import Finding, Verdict, readings

_NEAR, _APART = np.deg2rad([3.0, 3.0])  # of the pull to the attach point; between the best turn and the next
_ON_AXIS = np.deg2rad(15.0)  # of the pull to an attach point that is taken on the axis
_CLEAR = 0.3  # by which logarithm the signed columns of a channel have to fit better than all others
_OF_AXES = ("hanging.force", "hanging.attitude", "attitude.rate", "force.", "pull.", "riser.")
_WRONG_SIDE = "the attach point is on the wrong side"  # the vehicle's fault, or that of a record upside down
_CHANNELS = {"rate": "capsule_rate", "force": "capsule_specific_force"}


def _orders() -> tuple[Array, ...]:
    """All 48 ways to put axes onto axes (3, 3), mirrored ones too, the identity first."""
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = signs
        found.append(matrix)
    return tuple(found)


_ORDERS = _orders()
TURNS = tuple(matrix for matrix in _ORDERS if np.linalg.det(matrix) > 0.0)
"""The 24 turns that put axes onto axes (3, 3), the identity first."""


def text_of(turn: Array) -> str:
    """A turn (3, 3) as `body_axes` has it, such as ``-z y x``."""
    at = np.abs(turn).argmax(axis=1)
    return " ".join(f"{'-' if row[i] < 0.0 else ''}{'xyz'[i]}" for row, i in zip(turn, at, strict=True))


class BodyAxes(NamedTuple):
    """Body axes that reconcile a record with its vehicle.

    Attributes:
        turns: Of all channels from the axes as read into the vehicle's (3, 3); several where they can't be told apart.
        columns: Turns of gyros and accelerometers into the attitude's axes, by channel; empty where they are those.
    """

    turns: tuple[Array, ...]
    columns: dict[str, Array]


def turned_body(e: Evidence, turn: Array, names: tuple[str, ...] = ("rate", "force", "attitude")) -> Evidence:
    """The evidence with channels along other body axes: components are multiplied by the turn (3, 3)."""
    changes: dict[str, Any] = {}
    for name in names:
        values = getattr(e, name)
        if values is None:
            continue
        if name == "attitude":
            change = quaternion_product(values, np.broadcast_to(of_matrix(turn.T), (len(values), 4)))
        else:  # no product of matrices: a dead gyro would spoil the others
            at = np.abs(turn).argmax(axis=1)
            change = turn[range(3), at] * values[:, at]
        changes[name] = change
    return replace(e, **changes)


def body_axes_of(e: Evidence) -> BodyAxes | None:
    """Body axes that reconcile gyros with attitude, specific force with the motion, and all with the vehicle.

    Args:
        e: The evidence.

    Returns:
        None where they can't be found: no vehicle, no specific force, or no turn that reconciles them.
    """
    if e.vehicle is None or e.force is None or not np.linalg.norm(e.vehicle.attach_b) > 0.0:
        return None
    columns = _columns(e)
    if columns is None:
        return None
    for name, turn in columns.items():
        e = turned_body(e, turn, (name,))
    off = [_off(e, turn) for turn in TURNS]
    order = np.argsort(off)
    best, second = off[order[0]], off[order[1]]
    if best <= _NEAR and second - best >= _APART:
        ring = [turn for turn, angle in zip(TURNS, off, strict=True) if angle < best + 2.0 * _ON_AXIS]
        moments = [_unbalance(e, turn) for turn in ring]
        chosen = TURNS[order[0]]
        agrees = not np.isfinite(moments).all() or _unbalance(e, chosen) <= min(moments)
        return BodyAxes((chosen,), columns) if agrees else None
    if best <= _ON_AXIS:
        return BodyAxes(tuple(TURNS[i] for i in order if off[i] < best + _ON_AXIS), columns)
    return None


def _columns(e: Evidence) -> dict[str, Array] | None:
    """Turns of gyros and accelerometers into the attitude's axes; None where there is none, or more than one."""
    laws: dict[str, Callable[[Evidence], list[Reading]]] = {"rate": attitude, "force": specific_force}
    found: dict[str, Array] = {}
    for name, law in laws.items():
        if getattr(e, name) is None or _kept(law(e)):
            continue
        tried = sorted(((_misfit(law(turned_body(e, order, (name,)))), i) for i, order in enumerate(_ORDERS)))
        (best, chosen), (second, _) = tried[:2]
        order = _ORDERS[chosen]
        if second - best < _CLEAR or not _kept(law(turned_body(e, order, (name,)))) or np.linalg.det(order) < 0.0:
            return None
        found[name] = order
    return found


def _kept(found: list[Reading]) -> bool:
    return all(one.excess < FAULT for one in found)


def _misfit(found: list[Reading]) -> float:
    """Sum of the logarithms of what is left; by which factor does not matter."""
    return float(sum(np.log(max(one.excess, 1e-9)) for one in found if one.law not in ("attitude.norm", "force.size")))


def _off(e: Evidence, turn: Array) -> float:
    """Angle of the mean specific force to the attach point after a turn [rad]."""
    assert e.force is not None and e.vehicle is not None
    pull, reach = turn @ np.array([typical(x) for x in e.force.T]), e.vehicle.attach_b
    cosine = float(pull @ reach / (np.linalg.norm(pull) * np.linalg.norm(reach) + 1e-12))
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _unbalance(e: Evidence, turn: Array) -> float:
    """What is left of Euler's equations after a turn, its mean aside [rad/s^2]; NaN where rates or inertia lack."""
    if e.rate is None or e.force is None or e.vehicle is None:
        return np.nan
    v, k = e.vehicle, 2
    made = turned_body(e, turn, ("rate", "force"))
    assert made.rate is not None and made.force is not None
    rate, force = made.rate, made.force
    turning, pull = boxcar(rate, k), v.mass * boxcar(force, k)
    moment = slope(rate, k, e.step) * v.inertia + np.cross(turning, turning * v.inertia)
    left = (moment - np.cross(v.attach_b, pull)) / v.inertia
    left = left[np.isfinite(left).all(axis=1)]
    size = np.sort(np.sum((left - np.median(left, axis=0)) ** 2, axis=1)) if len(left) else np.array([np.nan])
    return float(np.sqrt(np.mean(size[: max(int(0.95 * size.size), 1)])))


@dataclass(frozen=True)
class _Advice:
    cause: str
    do: str


def _advice(found: BodyAxes, said: str | None) -> _Advice:
    """What is wrong, and what to write.

    Args:
        found: The body axes.
        said: `body_axes` with which the record was read; None: a record that is not read with such.
    """
    now = Conventions(body_axes=said or "x y z").body()
    texts = [text_of(turn @ now) for turn in found.turns]
    parts = []
    turn_is_needed = not np.array_equal(found.turns[0], TURNS[0])
    if turn_is_needed and said is None:
        parts.append(f"Turn its body axes: the vehicle's x, y, z are its {', '.join(texts[0].split())}.")
    elif turn_is_needed:
        parts.append(f'Say body_axes = "{texts[0]}".')
    if turn_is_needed and len(texts) > 1:
        more = ", ".join(f'"{text}"' for text in texts[1:])
        parts.append(f"Or {more}: an attach point on the axis does not tell y from z, the drawing does.")
    for name, turn in found.columns.items():
        of = text_of(now.T @ turn @ now).split()
        each = "; ".join(
            f"{axis} from {letter[-1]}{' with scale = -1' if letter.startswith('-') else ''}"
            for axis, letter in zip("xyz", of, strict=True)
        )
        parts.append(f"Take the columns of {_CHANNELS[name]} so: {each}.")
    if turn_is_needed:
        cause = f"body axes of the record are not the vehicle's, whose x, y, z are its {', '.join(texts[0].split())}"
    else:
        cause = f"body axes of {' and '.join(_CHANNELS[n] for n in found.columns)} are not those of the attitude"
    return _Advice(cause, " ".join(parts))


def with_axes(found: Verdict, said: str | None) -> Verdict:
    """A verdict whose advice on body axes is what to write, where the record tells it.

    A turn about the direction of the pull breaks no law; it is a warning where another one brings the pull clearly
    nearer to the vehicle's attach point.

    Args:
        found: What the laws say.
        said: `body_axes` with which the record was read; None: a record that is not read with such.
    """
    concerned = [one for one in found.findings if one.law.startswith(_OF_AXES)]
    others = [cause for cause in found.causes if not cause.startswith(("body ax", _WRONG_SIDE))]
    if (found.causes and found.causes[0] in others) or (found.faults and not concerned):
        return found
    with np.errstate(all="ignore"):
        axes = body_axes_of(found.evidence)
    if axes is None or (not axes.columns and any(np.array_equal(turn, TURNS[0]) for turn in axes.turns)):
        return found
    advice = _advice(axes, said)
    if not found.faults:
        return _warned(found, axes, advice)
    mended = found.evidence
    for name, turn in axes.columns.items():
        mended = turned_body(mended, turn, (name,))
    after = readings(turned_body(mended, axes.turns[0]))
    solved = {one.law for one in concerned if one.law in after and after[one.law].excess < FAULT}
    if not any(one.law in solved for one in found.faults):
        return found
    findings = tuple(_told(one, advice) if one.law in solved else one for one in found.findings)
    if all(one.likely.startswith(_WRONG_SIDE) for one in concerned if one.law in solved):
        findings = tuple(_either(one, advice) if one.law in solved else one for one in found.findings)
    causes = dict.fromkeys((*(one.likely for one in findings if one.law in solved), *found.causes))
    return replace(found, findings=findings, causes=tuple(c for c in causes if any(c == f.likely for f in findings)))


def _told(one: Finding, advice: _Advice) -> Finding:
    return replace(one, causes=(advice.cause,), do=advice.do)


def _either(one: Finding, advice: _Advice) -> Finding:
    """What the vehicle's file may have wrong, and the record instead."""
    return replace(one, causes=(*one.causes[:1], advice.cause), do=f"{one.do} If it is right: {advice.do}")


def _warned(found: Verdict, axes: BodyAxes, advice: _Advice) -> Verdict:
    """A verdict with a warning of a turn about the direction of the pull."""
    now, then = _off(found.evidence, TURNS[0]), _off(found.evidence, axes.turns[0])
    if len(axes.turns) > 1 or axes.columns or now - then < _APART:
        return found
    law = next((one for one in found.readings if one.law == "hanging.force"), None)
    if law is None or any(one.law == law.law for one in found.findings):
        return found
    wanted = f"what other body axes bring it to, {np.rad2deg(then):.1f} deg"
    do = f"{advice.do} Or mind the signs of attach_point in the vehicle's file."
    got = f"{np.rad2deg(now):.1f} deg"
    told = Finding(law.law, law.tests, got, wanted, law.excess, "warning", (advice.cause,), do)
    return replace(found, findings=(*found.findings, told), causes=(*found.causes, advice.cause))
