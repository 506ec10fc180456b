"""What JSBSim and RocketPy make of the written files: run by other_programs.py in an interpreter that has both.

    PYTHON other_programs_probe.py REQUEST.json ANSWER.json

Knows nothing of bayeschute. Units of the request and the answer are SI; azimuth is from body z towards y.
"""

from __future__ import annotations

import json
import math
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

FOOT, POUND, SLUG_PER_CUBIC_FOOT = 0.3048, 4.4482216152605, 515.3788183931961
LATITUDE = 45.5  # [deg], where the earth's pull less its turning is standard gravity


def jsbsim_model(root: str, name: str) -> Any:
    """An aircraft, loaded."""
    import jsbsim

    made = jsbsim.FGFDMExec(root)
    made.set_debug_level(0)
    made.set_aircraft_path("aircraft")
    if not made.load_model(name):
        raise SystemExit(f"JSBSim can't load {name}")
    made["ic/lat-geod-deg"] = LATITUDE
    return made


def jsbsim_forces(root: str, name: str, states: list[list[float]]) -> list[list[float]]:
    """Density, forces along and moments about body axes at states: angle, azimuth, speed, p, q, r, altitude."""
    fdm, rows = jsbsim_model(root, name), []
    read = [f"forces/fb{a}-aero-lbs" for a in "xyz"] + [f"moments/{a}-aero-lbsft" for a in "lmn"]
    unit = [POUND] * 3 + [POUND * FOOT] * 3
    for angle, azimuth, speed, p, q, r, altitude in states:
        along = (math.cos(angle), math.sin(angle) * math.sin(azimuth), math.sin(angle) * math.cos(azimuth))
        fdm["ic/theta-rad"], fdm["ic/h-sl-ft"] = -1.2, altitude / FOOT
        for axis, part in zip("uvw", along, strict=True):
            fdm[f"ic/{axis}-fps"] = speed * part / FOOT
        for axis, rate in zip("pqr", (p, q, r), strict=True):
            fdm[f"ic/{axis}-rad_sec"] = rate
        fdm.run_ic()
        density = fdm["atmosphere/rho-slugs_ft3"] * SLUG_PER_CUBIC_FOOT
        rows.append([density, *(fdm[key] * size for key, size in zip(read, unit, strict=True))])
    return rows


def jsbsim_descent(root: str, name: str, release: float, altitudes: list[float], swing: float | None) -> list[float]:
    """Descent rates at falling altitudes, NaN where it never comes.

    Without a swing the body is held upright, else it is released at that angle.
    """
    fdm, rates = jsbsim_model(root, name), []
    fdm.set_dt(0.005)
    fdm["ic/h-sl-ft"], fdm["ic/theta-rad"], fdm["ic/vd-fps"] = release / FOOT, -0.5 * math.pi + (swing or 0.0), 30.0
    if swing is None:
        fdm["simulation/integrator/rate/rotational"] = fdm["simulation/integrator/position/rotational"] = 0
    fdm.run_ic()
    before = 1.0e9
    while len(rates) < len(altitudes) and fdm.get_sim_time() < 1200.0:
        fdm.run()
        now = fdm["position/h-sl-ft"] * FOOT
        if now <= altitudes[len(rates)] < before:
            rates.append(fdm["velocities/v-down-fps"] * FOOT)
        before = now
    return rates + [math.nan] * (len(altitudes) - len(rates))


def rocketpy_descent(chutes: Any, draw: int | None, release: float) -> list[list[float]]:
    """Times, altitudes and descent rates of a flight that opens its parachute at once, from rest."""
    import rocketpy

    air = rocketpy.Environment(latitude=LATITUDE, longitude=0.0, elevation=0.0)
    air.set_atmospheric_model("standard_atmosphere")
    rocket = rocket_of(rocketpy, chutes.mass(draw))
    rocket.add_parachute(**chutes.arguments(draw, trigger=lambda pressure, height, state: True))
    start = [0.0, 0.0, 0.0, release, 0.0, 0.0, 0.0, 1.0, *(0.0,) * 6]
    flight = rocketpy.Flight(rocket, air, rail_length=1.0, initial_solution=start, max_time=1200.0)
    return [[float(row[0]), float(row[3]), -float(row[6])] for row in flight.solution]


def rocket_of(rocketpy: Any, mass: float) -> Any:
    """A rocket without a motor."""
    made = rocketpy.Rocket(
        radius=2.5, mass=mass, inertia=(1e4, 1e4, 1e4), power_off_drag=0.5, power_on_drag=0.5,
        center_of_mass_without_motor=0.0,
    )  # fmt: skip
    made.add_motor(rocketpy.EmptyMotor(), 0.0)
    return made


def rocketpy_parachutes(chutes: Any, picks: int) -> dict[str, Any]:
    """Drag areas and half-ball volumes of the parachutes of every draw, of picked ones, and in a stochastic rocket."""
    import rocketpy

    def told(one: Any) -> list[float]:
        volume = 2.0 / 3.0 * math.pi * getattr(one, "radius", math.nan) ** 2 * getattr(one, "height", math.nan)
        return [float(one.cd_s), getattr(one, "added_mass_coefficient", math.nan) * volume]

    stochastic = chutes.stochastic(trigger="apogee")
    rocket = rocketpy.StochasticRocket(rocket_of(rocketpy, chutes.mass()))
    rocket.add_parachute(chutes.stochastic(trigger="apogee", lag=1.5))
    return {
        "draws": [told(one) for one in chutes.parachutes(trigger=800.0)],
        "picked": [told(stochastic.create_object()) for _ in range(picks)],
        "rocket": [told(rocket.create_object().parachutes[0]) for _ in range(3)],
    }


def main(asked: dict[str, Any]) -> dict[str, Any]:
    """Answer a request."""
    sys.path.insert(0, asked["folder"])
    import rocketpy_parachutes as chutes

    root, answer = asked["folder"], {"versions": {name: version(name) for name in ("jsbsim", "rocketpy")}}
    held, release = asked["descents_of"], asked["release"]
    return answer | {
        "forces": jsbsim_forces(root, asked["forces_of"], asked["states"]),
        "descents": [jsbsim_descent(root, name, release, asked["altitudes"], None) for name in held],
        "free": jsbsim_descent(root, held[0], release, asked["free_altitudes"], asked["swing"]),
        "flights": [rocketpy_descent(chutes, draw, release) for draw in asked["draws"]],
        "parachutes": rocketpy_parachutes(chutes, asked["picks"]),
    }


if __name__ == "__main__":
    request, reply = map(Path, sys.argv[1:3])
    reply.write_text(json.dumps(main(json.loads(request.read_text(encoding="utf-8")))), encoding="utf-8")
