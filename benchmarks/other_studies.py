"""Studies of the flights in other_records.py: the default study, told of another vehicle, written into a folder.

One template serves all sets. Structure, priors, noise, sampler and predictions are the default study's, whatever it
says. Only what depends on the vehicle is put in its place, by one rule for all, from nominal values and the record:

| what | rule |
|---|---|
| vehicle | the meta file; what no meta file tells: as in the default vehicle |
| capsule's force | drag along the flow alone, by the coefficient of the meta file: C_A = -C_D, normal force slope C_D |
| reference speed | terminal speed of the nominal weight in sea-level air, with a drag coefficient of 0.85 |
| prior of the risers | medians nominal, log sd as in the default; length nominal, sd 0.6 % of it or 0.2 m, the larger |
| prior of the canopies' pitching moment | mean 0, sd 0.3 of C_m_alpha and C_mq |
| prior of the capsule's pitching moment | means as in the vehicle; sd 0.1 of C_m_alpha, 1 of C_mq |
| prior of the capsule's force | C_A and the normal force slope as in the vehicle, sd 0.3 each |
| prior of constant errors | sd 0.5 m of canopy positions, 0.5 deg of the attitude |
| prior of the canopies' apparent mass | median: air of the enclosed volume of the meta file; log sd 0.5 |
| noise of channels | white part: scatter of the record's own samples; correlated: as many times that as by default |
| breathing | frequency times reference speed over diameter, over that of the default vehicle |
| slow vertical air | its time constant at most 1.5 times the default's, as `bayeschute init` states it |
| powers of the angle of attack | may level off (`saturate = "auto"`), as `bayeschute init` states it |
| rate | 10 Hz, or that of the canopies' samples where they are fewer |
| one canopy | terms that need a neighbour are left out |
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from other_records import G0, SEA_LEVEL_DENSITY, OtherFlight, first_seen, read_flight, record

from bayeschute.aero.term_names import is_pairwise

MODELS = Path(__file__).parents[1] / "models"
STUDY = MODELS / "studies" / "cdt-3-11.toml"
if TYPE_CHECKING:
    import bayeschute as bc

RATE = 10.0  # [Hz]
BEGIN, END = 5.0, 2.0  # left out at the ends of the flight that is identified [s]
NOMINAL_DRAG = 0.85  # of a canopy
MOMENT = 0.3  # sd of a canopy's C_m_alpha and C_mq
AIR_LOG_SD = 0.5  # of a canopy's apparent mass, which no meta file gives, over that of its enclosed air
SCALE = 0.01  # sd of the scale of canopy positions, which are from video
CAPSULE = {"pitch_moment_slope": 0.1, "pitch_damping": 1.0}  # sd
DRAG = 0.3  # sd of C_A and of the slope of the normal force about the estimate
INERTIA = 0.02  # sd of moments of inertia over those that are told
LONGEST = 1.5  # times the default's time constant: of slow vertical air
BIASES = {  # constant errors of a record, as `bayeschute init` states them
    "canopy_position_bias": {"sd": "0.5 m"},
    "capsule_attitude_bias": {"sd": "0.5 deg"},
}
LENGTH_SHARE, LENGTH_LEAST = 0.006, 0.2  # sd of a riser's length: share of it, and [m]
_KINDS = ("axial", "transverse")
_UNITS = {"canopy_position": "m", "capsule_velocity": "m/s", "capsule_attitude": "rad"}
_OF_META = {
    "riser_stiffness": ("riser_stiffness_Npm", "N/m"),
    "riser_damping": ("riser_damping_Nspm", "N s/m"),
    "capsule_mass": ("capsule_mass_kg", "kg"),
    "canopy_mass": ("canopy_dry_mass_kg", "kg"),
}
_SHARED = ("seed", "model")
_PER_FLIGHT = ("title", "vehicle", "flight", "columns")


def toml(table: Mapping[str, Any], path: str = "") -> str:
    """A table as TOML: its values, then its tables and its lists of tables.

    Args:
        table: Strings, numbers, truth values, lists of these, tables and lists of tables.
        path: Name of the table, with dots; empty at the top.
    """
    own, below = list[str](), list[str]()
    for key, value in table.items():
        name = key if key.replace("_", "").replace("-", "").isalnum() else json.dumps(key)
        inside = f"{path}.{name}" if path else name
        if isinstance(value, Mapping):
            below.append(f"\n[{inside}]\n{toml(value, inside)}")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            below += [f"\n[[{inside}]]\n{toml(entry, inside)}" for entry in value]
        else:
            own.append(f"{name} = {json.dumps(value, ensure_ascii=False)}\n")
    return "".join(own + below)


def _si(value: float, unit: str) -> str:
    return f"{value:.6g} {unit}".strip()


def _magnitude(text: str, unit: str) -> float:
    """A quantity with its unit, such as ``"0.15 m"``, in SI."""
    from bayeschute.core.units import factor_to_si

    number, _, given = text.partition(" ")
    scale, zero = factor_to_si(given, unit)
    return scale * float(number) + zero


def terminal_speed(meta: Mapping[str, Any]) -> float:
    """Of the nominal weight in sea-level air [m/s]."""
    n = meta["n_canopies"]
    weight = G0 * (meta["capsule_mass_kg"] + n * meta["canopy_dry_mass_kg"])
    area = n * meta["canopy_reference_area_m2"]
    return float(np.sqrt(2.0 * weight / (SEA_LEVEL_DENSITY * NOMINAL_DRAG * area)))


def default_study() -> dict[str, Any]:
    """The default study's tables."""
    return tomllib.loads(STUDY.read_text(encoding="utf-8"))


def default_vehicle() -> dict[str, Any]:
    """The default study's vehicle."""
    return tomllib.loads((STUDY.parent / default_study()["vehicle"]).read_text(encoding="utf-8"))


def _alone(terms: Sequence[str]) -> list[str]:
    return [term for term in terms if not is_pairwise(term)]


def vehicle(flight: OtherFlight) -> dict[str, Any]:
    """Tables of the vehicle of a flight, nominal values throughout."""
    meta, made = flight.meta, default_vehicle()
    high = float(flight.attach_b[0])  # our attach point is the origin of the structural frame, but for y and z
    place = [_si(high, "m"), "0 m", "0 m"]
    drag = meta["capsule_CD_estimate"]  # along the flow
    capsule = {k: v for k, v in made["capsule"].items() if k == "pitch_moment_slope" or k.endswith("_damping")}
    capsule |= {
        "mass": _si(meta["capsule_mass_kg"], "kg"),
        "inertia": [_si(x, "kg m^2") for x in np.diag(flight.inertia)],
        "inertia_products": [_si(flight.inertia[i, j], "kg m^2") for i, j in ((0, 1), (0, 2), (1, 2))],
        "reference_area": _si(meta["capsule_reference_area_m2"], "m^2"),
        "reference_length": _si(2.0 * np.sqrt(meta["capsule_reference_area_m2"] / np.pi), "m"),
        "centre_of_mass": place,
        "attach_point": ["0 m", _si(flight.attach_b[1], "m"), _si(-flight.attach_b[2], "m")],
        "reference_centre": place,
        "axial_force": -drag,
        "normal_force_slope": drag,
    }
    n = meta["n_canopies"]
    canopies = {
        "number": n,
        "reference_length": _si(meta["canopy_nominal_diameter_m"], "m"),
        "reference_area": _si(meta["canopy_reference_area_m2"], "m^2"),
        "reference_speed": _si(terminal_speed(meta), "m/s"),
        "dry_mass": _si(meta["canopy_dry_mass_kg"], "kg"),
        "enclosed_volume": _si(meta["canopy_enclosed_volume_m3"], "m^3"),
    }
    risers = {
        "length": _si(meta["line_length_unstretched_m"], "m"),
        "stiffness": _si(meta["riser_stiffness_Npm"], "N/m"),
        "damping": _si(meta["riser_damping_Nspm"], "N s/m"),
    }
    aero = made["aero"]
    if n == 1:
        aero |= {kind: {t: v for t, v in aero[kind].items() if t in _alone(list(aero[kind]))} for kind in _KINDS}
    made |= {"name": f"Set {flight.name[0]}, nominal", "capsule": capsule, "canopies": canopies, "risers": risers}
    return made | {"aero": aero}


def _given(default: Mapping[str, Any], meta: Mapping[str, Any]) -> dict[str, Any]:
    """Priors from outside: those of the default about this vehicle's nominal values."""
    made = dict(default)
    for name, (key, unit) in _OF_META.items():
        if name in made and "median" in made[name]:
            made[name] = made[name] | {"median": _si(meta[key], unit)}
        elif name in made:
            share = _magnitude(made[name]["sd"], unit) / _magnitude(made[name]["mean"], unit)
            made[name] = {"mean": _si(meta[key], unit), "sd": _si(share * meta[key], unit)}
    length = meta["line_length_unstretched_m"]
    sd = max(LENGTH_SHARE * length, LENGTH_LEAST)
    made |= {f"canopy_{of}": {"mean": 0.0, "sd": MOMENT} for of in ("pitch_moment_slope", "pitch_damping")}
    made |= {"enclosed_air_factor": {"median": 1.0, "log_sd": AIR_LOG_SD}}
    made |= {"canopy_position_scale": {"mean": 1.0, "sd": SCALE}} | BIASES
    usual = default_vehicle()["capsule"]
    made |= {f"capsule_{of}": {"mean": usual[of], "sd": sd} for of, sd in CAPSULE.items()}
    drag = meta["capsule_CD_estimate"]
    made |= {"capsule_axial_force": {"mean": -drag, "sd": DRAG}}
    made |= {"capsule_normal_force_slope": {"mean": drag, "sd": DRAG}}
    made |= {f"capsule_inertia_factor_{axis}": {"mean": 1.0, "sd": INERTIA} for axis in "yz"}
    return made | {"riser_length": {"mean": _si(length, "m"), "sd": _si(sd, "m")}}


def _noise(default: Mapping[str, Any], flight: OtherFlight) -> dict[str, Any]:
    """Noise of the channels at the scale of the record, breathing at that of the canopies."""
    made, seen = dict(default), flight.scatter()
    for name, unit in _UNITS.items():
        if name in made:
            table = dict(made[name])
            white = _magnitude(table["white"], unit) if "white" in table else None
            for key in ("white", "correlated"):
                if key in table:
                    ratio = 1.0 if white is None else _magnitude(table[key], unit) / white
                    table[key] = _si(ratio * seen[name], unit)
            made[name] = table
    slow = made["slow_wind"]
    longest = LONGEST * _magnitude(slow["time_constant"], "s")
    made["slow_wind"] = slow | {"vertical_time_constant_at_most": _si(longest, "s")}
    if "breathing" in made:
        usual, meta = default_vehicle()["canopies"], flight.meta
        before = _magnitude(usual["reference_speed"], "m/s") / _magnitude(usual["reference_length"], "m")
        now = terminal_speed(meta) / meta["canopy_nominal_diameter_m"]
        frequency = _magnitude(made["breathing"]["frequency"], "Hz") * now / before
        made["breathing"] = made["breathing"] | {"frequency": _si(frequency, "Hz")}
    return made


def study(
    first: OtherFlight, window: tuple[float, float], predicted: Sequence[OtherFlight] = (), title: str = ""
) -> dict[str, Any]:
    """Tables of a study.

    Args:
        first: The flight that is identified.
        window: Its first and last time used, on its clock [s].
        predicted: Flights that are foretold.
        title: For the report; empty: made of the flights' names.
    """
    default, meta = default_study(), first.meta
    structure = dict(default["structure"]) | {"saturate": "auto"}
    if meta["n_canopies"] == 1:
        structure |= {kind: _alone(structure[kind]) for kind in _KINDS}
    priors = default["priors"] | {"given": _given(default["priors"].get("given", {}), meta)}
    if meta["n_canopies"] == 1 and "spread" in priors:
        priors["spread"] = {k: v for k, v in priors["spread"].items() if not is_pairwise(k[k.find("[") + 1 : -1])}
    flights = [_flight(first, {"roles": ["structure", "identify"], "window": [_time(t) for t in window]})]
    flights += [
        _flight(f, {"roles": ["predict"], "window": [_time(first_seen(f, 0.0)), _time(float(f.time[-1]))]})
        | {"capsule_mass": _si(f.meta["capsule_mass_kg"], "kg")}
        for f in predicted
    ]
    names = " and ".join(f.name for f in predicted)
    head = {"title": title or f"{first.name} identified" + (f", {names} predicted" if names else "")}
    head |= {key: default[key] for key in _SHARED} | {"vehicle": "vehicle.toml", "flight": flights}
    rest = {key: value for key, value in default.items() if key not in (*_SHARED, *_PER_FLIGHT)}
    return head | rest | {"structure": structure, "priors": priors, "noise": _noise(default["noise"], first)}


def _time(t: float) -> str:
    return f"{t:.3f} s"


def _rate(flight: OtherFlight) -> float:
    """At which canopies are seen, and at most `RATE` [Hz]."""
    seen = flight.time[np.isfinite(flight.canopies).all(axis=(1, 2))]
    return min(RATE, round(1.0 / float(np.median(np.diff(seen))), 3))


def _flight(flight: OtherFlight, more: Mapping[str, Any]) -> dict[str, Any]:
    profile = {"file": f"{flight.name}_wind.csv", "altitude": {"column": "altitude", "unit": "m"}}
    profile |= {axis: {"column": axis, "unit": "m/s"} for axis in ("north", "east")}
    rate = f"{_rate(flight):g} Hz"
    own = {"name": flight.name, "file": f"{flight.name}.nc", "rate": rate, "simulated_by": "another program"}
    return own | dict(more) | {"wind_profile": {"profile": profile}}


def write_flight(flight: OtherFlight, folder: Path, known_for: float | None = None) -> None:
    """The record and the wind by altitude of a flight, beside its study.

    Args:
        flight: The flight.
        folder: Where to.
        known_for: As of `other_records.record` [s].
    """
    from bayeschute.records.record import write_record

    write_record(record(flight, known_for), folder / f"{flight.name}.nc")
    head = "altitude,north,east"
    np.savetxt(folder / f"{flight.name}_wind.csv", flight.profile, "%.6g", ",", header=head, comments="")


def write_set(data: Path, names: Sequence[str], folder: Path) -> Path:
    """A set's records, vehicle and study.

    Of a flight to be predicted the record holds the opening by which the program knows it, and the air's density.

    Args:
        data: Folder of the sets.
        names: Of the flight that is identified, and of those that are predicted.
        folder: Where to.

    Returns:
        Path of the study.
    """
    from bayeschute.prediction.bands import OPENING

    folder.mkdir(parents=True, exist_ok=True)
    first, *predicted = (read_flight(data, name) for name in names)
    write_flight(first, folder)
    for flight in predicted:
        write_flight(flight, folder, first_seen(flight, 0.0) - float(flight.time[0]) + OPENING)
    window = (first_seen(first, BEGIN), float(first.time[-1]) - END)
    (folder / "vehicle.toml").write_text(toml(vehicle(first)), encoding="utf-8")
    path = folder / f"{names[0]}.toml"
    path.write_text(toml(study(first, window, predicted)), encoding="utf-8")
    return path


def flight_alone(data: Path, name: str, folder: Path) -> bc.Flight:
    """A flight to be predicted by a posterior, with a vehicle of its own; its record holds no more than `write_set`'s.

    Args:
        data: Folder of the sets.
        name: Of the flight.
        folder: Where its vehicle file is written.
    """
    import bayeschute as bc
    from bayeschute.prediction.bands import OPENING

    flight = read_flight(data, name)
    path = folder / f"{name}_vehicle.toml"
    path.write_text(toml(vehicle(flight)), encoding="utf-8")
    begin = first_seen(flight, 0.0)
    return bc.Flight(
        record(flight, begin - float(flight.time[0]) + OPENING),
        bc.load_vehicle(path),
        name=name,
        wind=bc.wind_profile(*flight.profile.T),
        window=(begin, float(flight.time[-1])),
        rate=_rate(flight),
        roles=("predict",),
    )


def write_window(data: Path, name: str, length: float, folder: Path) -> Path | None:
    """A study of so many seconds of a flight, beside what `write_set` left in the folder; None: it is too short.

    Args:
        data: Folder of the sets.
        name: Of the flight.
        length: Of the window [s].
        folder: Of the set.
    """
    flight = read_flight(data, name)
    start = first_seen(flight, BEGIN)
    if start + length > flight.time[-1]:
        return None
    path = folder / f"{name}_{length:g}s.toml"
    title = f"{name}, {length:g} s of it"
    path.write_text(toml(study(flight, (start, start + length), title=title)), encoding="utf-8")
    return path
