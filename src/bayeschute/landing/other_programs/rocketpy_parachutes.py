"""Parachutes for RocketPy: a JSON file with what each draw says, and a Python module that makes them of it.

RocketPy (classes Parachute or, in newer versions, HemisphericalParachute, and StochasticParachute) lets a point of the
rocket's dry mass descend under a drag area ``cd_s`` and an added mass

    m_a = k rho (2/3) pi radius^2 height,   k = 1.068 (1 - 1.465 p - 0.25975 p^2 + 1.2626 p^3),   p: porosity.

``cd_s`` is the drag area of the steady cluster, 2 m g/(rho V^2), with the capsule's own, as RocketPy counts no drag of
the body once a parachute is open. ``radius`` and ``height`` are equal, those of a half ball that carries the enclosed
air of all canopies at RocketPy's usual porosity: a way to say the added mass, no size of a canopy.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.core.files import write_whole
from bayeschute.core.version import __version__
from bayeschute.landing.other_programs.steady_cluster import SteadyCluster

Array = NDArray[np.float64]
POROSITY = 0.0432
DATA, MODULE = "rocketpy_parachutes.json", "rocketpy_parachutes.py"
ENTRIES = {
    "draw": ("1", "number of the draw of the parameters, from 0; absent from the mean"),
    "cd_s": ("m^2", "drag area of all canopies and the capsule in a steady descent: 2 m g/(rho V^2)"),
    "canopies_cd_s": ("m^2", "of all canopies alone"),
    "radius": ("m", "of a half ball that carries the air enclosed by all canopies at this porosity; no canopy's size"),
    "height": ("m", "equal to the radius"),
    "porosity": ("1", "RocketPy's usual one, with which its added mass is that of the half ball"),
    "mass": ("kg", "of capsule and dry canopies: the rocket's dry mass under the parachute"),
    "flyout": ("deg", "angle of every riser off the vertical"),
    "sea_level_descent_rate": ("m/s", "sqrt(2 m g/(rho cd_s)) in sea-level air"),
}
"""Unit and meaning of every entry of the mean and of a draw."""
_MODULE = '''"""Parachutes of a bayeschute posterior for RocketPy; their numbers are in the JSON file beside this one.

    import rocketpy_parachutes as chutes

    rocket.add_parachute(**chutes.arguments(trigger=1500.0))      # by the posterior mean
    rocket.add_parachute(**chutes.arguments(draw=17))             # by a draw: a Monte Carlo study takes one a flight
    stochastic_rocket.add_parachute(chutes.stochastic(trigger="apogee"))

Under the parachute RocketPy takes the dry mass of rocket and motor: let that be `mass(draw)` [kg] for the descent rate
to be that of the posterior. The drag area has the capsule's part. Nothing swings: RocketPy's body is a point then.

A StochasticRocket of RocketPy 1.13.0 and before makes its parachutes without radius, height and porosity (RocketPy's
issue 1094), so with another added mass: its descents settle at the same rate, but not as soon. `arguments` keeps them.
"""

import json
from inspect import signature
from pathlib import Path

try:
    from rocketpy.rocket.parachutes import HemisphericalParachute as Parachute
except ImportError:
    from rocketpy import Parachute

DATA = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
MEAN, DRAWS = DATA["mean"], DATA["draws"]
_TAKEN = ("cd_s", "radius", "height", "porosity")


def numbers(draw=None):
    """Numbers of a draw of the parameters, counted from 0; None: of the posterior mean."""
    if draw is None:
        return MEAN
    if not 0 <= draw < len(DRAWS):
        raise IndexError(f"there are draws 0 to {len(DRAWS) - 1}, not {draw}")
    return DRAWS[draw]


def mass(draw=None):
    """Mass of capsule and canopies [kg]."""
    return numbers(draw)["mass"]


def arguments(draw=None, **others):
    """Keyword arguments of `Rocket.add_parachute` and of a parachute; `others`, such as trigger and lag, go before."""
    said = {"name": DATA["name"], "trigger": "apogee", "sampling_rate": 100, "lag": 0, "noise": (0, 0, 0)}
    known = signature(Parachute).parameters
    return {**said, **{key: numbers(draw)[key] for key in _TAKEN if key in known}, **others}


def parachute(draw=None, **others):
    """A parachute by a draw, or by the posterior mean."""
    return Parachute(**arguments(draw, **others))


def parachutes(**others):
    """A parachute for every draw, in order."""
    return [parachute(draw, **others) for draw in range(len(DRAWS))]


def stochastic(**others):
    """A parachute whose drag area is picked from the draws; the other numbers are those of the mean."""
    from rocketpy import StochasticParachute

    return StochasticParachute(parachute(**others), cd_s=[one["cd_s"] for one in DRAWS])
'''


def entries(steady: SteadyCluster) -> dict[str, Any]:
    """The mean and all draws: numbers by the names of `ENTRIES`.

    The mean is that of the draws' drag areas, masses, enclosed volumes and angles; radius and descent rate follow.
    """
    columns = [steady.drag_area, steady.canopy_drag_area, steady.mass, steady.flyout, steady.enclosed_volume]
    gravity, rows = float(steady.gravity[0]), np.transpose(columns)
    draws: list[dict[str, Any]] = [{"draw": i, **_one(row, gravity)} for i, row in enumerate(rows)]
    return {"mean": _one(rows.mean(axis=0), gravity), "draws": draws}


def _one(row: Array, gravity: float) -> dict[str, float]:
    total, canopies, mass, flyout, volume = (float(x) for x in row)
    p = POROSITY
    added = 1.068 * (1.0 - 1.465 * p - 0.25975 * p**2 + 1.2626 * p**3)
    radius = float(np.cbrt(1.5 * volume / (np.pi * added)))
    rate = float(np.sqrt(2.0 * mass * gravity / (SEA_LEVEL_DENSITY * total)))
    return {
        "cd_s": total, "canopies_cd_s": canopies, "radius": radius, "height": radius, "porosity": p, "mass": mass,
        "flyout": float(np.rad2deg(flyout)), "sea_level_descent_rate": rate,
    }  # fmt: skip


def write(name: str, steady: SteadyCluster, folder: Path) -> tuple[Path, Path]:
    """Write data and module into a folder.

    Args:
        name: Of the parachute.
        steady: Steady descents of all draws.
        folder: Where to; made if missing.

    Returns:
        Paths of the JSON file and of the module.
    """
    units = {key: unit for key, (unit, _) in ENTRIES.items()}
    said = {"name": name, "made_by": f"bayeschute {__version__}", "units": units, **entries(steady)}
    text = json.dumps(said, indent=1)
    write_whole(folder / DATA, lambda part: part.write_text(text, encoding="utf-8"))
    write_whole(folder / MODULE, lambda part: part.write_text(_MODULE, encoding="utf-8"))
    return folder / DATA, folder / MODULE
