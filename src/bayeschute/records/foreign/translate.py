"""Columns of other conventions as those of the schema: directions, speeds and directions of wind, attitudes, axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import Fault
from bayeschute.records.foreign.attitudes import in_schema, of_euler, rate_of_attitude
from bayeschute.records.foreign.conventions import DIRECTIONS, Conventions
from bayeschute.records.record import AXIS, BODY_AXIS, QUATERNION, VARIABLES

Array = NDArray[np.float64]

EARTH_LABELS = ("north", "south", "east", "west", "up", "down", "x", "y", "z")
EULER = ("yaw", "pitch", "roll")
WIND_POLAR = ("speed", "direction")
WEEK = "time.week"


def foreign_unit(key: str) -> str | None:
    """SI unit of a key that the schema itself has not; None where it is none of these either."""
    parts = key.split(".")
    if key == WEEK:
        return "1"
    if parts[0] == "capsule_attitude" and parts[1:] in [[angle] for angle in EULER]:
        return "rad"
    if parts[0] == "wind" and parts[1:] in [[part] for part in WIND_POLAR]:
        return "rad" if parts[1] == "direction" else "m/s"
    variable = VARIABLES.get(parts[0])
    if variable is None or "axis" not in variable.dims or len(parts) != len(variable.dims):
        return None
    return variable.unit if parts[-1] in EARTH_LABELS else None


def _direction(label: str, said: Conventions) -> tuple[str, float]:
    """Component of the schema that a label is along, and its sign."""
    letter = said.axes["xyz".index(label)] if label in ("x", "y", "z") else label[0].upper()
    axis, sign = DIRECTIONS[letter]
    return AXIS[axis], sign


def schema_keys(keys: Iterable[str], said: Conventions) -> tuple[dict[str, list[str]], list[Fault]]:
    """Keys of the schema and the record's keys that each is made of.

    Args:
        keys: Of the column map, and of components that the record lacks.
        said: Conventions.

    Returns:
        The keys; and faults: two columns for one component, Euler angles beside quaternions, incomplete winds.
    """
    made: dict[str, list[str]] = {}
    faults: list[Fault] = []
    keys = list(keys)
    for key in keys:
        name, *rest = key.split(".")
        if key == WEEK or (name == "wind" and rest and rest[-1] in WIND_POLAR):
            continue
        if name == "capsule_attitude" and rest and rest[-1] in EULER:
            continue
        target = key
        if name in VARIABLES and "axis" in VARIABLES[name].dims and rest:
            target = ".".join([name, *rest[:-1], _direction(rest[-1], said)[0]])
        made.setdefault(target, []).append(key)
    for target, sources in made.items():
        if len(sources) > 1:
            got = f"columns for {' and for '.join(sources)}"
            faults.append(Fault(f"[columns.{sources[1]}]", got, f"one column that tells {target}", "Remove one."))
    angles = [key for key in keys if key.startswith("capsule_attitude.") and key.split(".")[-1] in EULER]
    if angles:
        faults += _group_faults("capsule_attitude", EULER, angles, made, QUATERNION)
        made |= {f"capsule_attitude.{part}": angles for part in QUATERNION}
    polar = [f"wind.{part}" for part in WIND_POLAR if f"wind.{part}" in keys]
    if polar:
        faults += _group_faults("wind", WIND_POLAR, polar, made, ("north", "east"))
        if said.wind_is is None:
            do = "Meteorology says where the wind comes from: wind_is = 'from'."
            faults.append(
                Fault("[columns.wind.direction]", "a direction of the wind", "wind_is, 'from' or 'towards'", do)
            )
        made |= {f"wind.{part}": polar for part in ("north", "east")}
    if any(key.startswith("capsule_attitude.") for key in keys) and np.linalg.det(said.earth()) < 0.0:
        wanted = "axes that make a right-handed system, where an attitude is recorded"
        faults.append(Fault("[conventions] axes", repr(said.axes), wanted, "Name columns by north, east, up, instead."))
    return made, faults


def _group_faults(
    name: str, parts: tuple[str, ...], given: list[str], made: Mapping[str, list[str]], instead: tuple[str, ...]
) -> list[Fault]:
    missing = [f"{name}.{part}" for part in parts if f"{name}.{part}" not in given]
    faults = [Fault("[columns]", f"no {one}", f"every one of {', '.join(parts)} of {name}") for one in missing]
    both = [f"{name}.{part}" for part in instead if f"{name}.{part}" in made]
    if both:
        got = f"{', '.join(given)} and {', '.join(both)}"
        faults.append(Fault("[columns]", got, f"one way to tell {name}", "Remove the others."))
    return faults


def in_schema_keys(found: Mapping[str, Array], said: Conventions) -> dict[str, Array]:
    """Columns by the schema's keys, in its axes and senses.

    Args:
        found: Columns in SI by the record's keys, all of one length; what the record lacks is NaN.
        said: Conventions.
    """
    made: dict[str, Array] = {}
    for key, values in found.items():
        name, *rest = key.split(".")
        if key == WEEK or name == "capsule_attitude" or (name == "wind" and rest[-1] in WIND_POLAR):
            continue
        if name in VARIABLES and "axis" in VARIABLES[name].dims:
            label, sign = _direction(rest[-1], said)
            if name == "wind" and said.wind_is == "from" and label != "down":
                sign = -sign
            made[".".join([name, *rest[:-1], label])] = sign * values
        else:
            made[key] = values
    if "wind.speed" in found:
        sign = -1.0 if said.wind_is == "from" else 1.0
        speed, direction = sign * found["wind.speed"], found["wind.direction"]
        made |= {"wind.north": speed * np.cos(direction), "wind.east": speed * np.sin(direction)}
    if "capsule_attitude.yaw" in found:
        yaw, pitch, roll = (found[f"capsule_attitude.{part}"] for part in EULER)
        q = of_euler(yaw, pitch, roll, said.euler)
    elif "capsule_attitude.w" in found:
        q = np.stack([found[f"capsule_attitude.{part}"] for part in QUATERNION], axis=1)
    else:
        q = None
    usual = (said.axes, said.body_axes.split(), said.attitude) == ("NED", ["x", "y", "z"], "body to earth")
    plain = usual and "capsule_attitude.yaw" not in found
    if q is not None:
        q = q if plain else in_schema(q, said)
        made |= {f"capsule_attitude.{part}": x for part, x in zip(QUATERNION, q.T, strict=True)}
    for name in ("capsule_rate", "capsule_specific_force"):
        if f"{name}.x" in made and not plain:
            _turn_body(made, name, said.body())
    return made


def _turn_body(made: dict[str, Array], name: str, body: Array) -> None:
    """Components along the vehicle's body axes; one that is missing does not spoil the others."""
    theirs = [made[f"{name}.{axis}"] for axis in BODY_AXIS]
    for row, axis in zip(body, BODY_AXIS, strict=True):
        at = int(np.flatnonzero(row)[0])
        made[f"{name}.{axis}"] = row[at] * theirs[at]


def fill_rates(made: dict[str, Array]) -> list[str]:
    """Put what the attitude says where a gyro has no value at all; returns the components that were filled."""
    if "capsule_rate.x" not in made or "capsule_attitude.w" not in made:
        return []
    dead = [axis for axis in BODY_AXIS if not np.isfinite(made[f"capsule_rate.{axis}"]).any()]
    if dead:
        q = np.stack([made[f"capsule_attitude.{part}"] for part in QUATERNION], axis=1)
        rate = rate_of_attitude(made["time"], q)
        for axis in dead:
            made[f"capsule_rate.{axis}"] = rate[:, BODY_AXIS.index(axis)]
    return dead
