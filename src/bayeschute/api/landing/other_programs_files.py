"""Canopies of a campaign's draws as files that JSBSim and RocketPy load."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bayeschute.core.errors import Fault, InputError
from bayeschute.landing.aero_table import ANGLES
from bayeschute.landing.campaign_plan import CampaignPlan, Parameters
from bayeschute.landing.other_programs import jsbsim_aerodynamics, rocketpy_parachutes
from bayeschute.landing.other_programs.steady_cluster import SteadyCluster, cluster_coefficients, steady_clusters

JSBSIM = "jsbsim_canopies.xml"


def write_jsbsim(
    plan: CampaignPlan, name: str, path: Path, draw: int | None = None, steady: SteadyCluster | None = None
) -> Path:
    """Write an ``<aerodynamics>`` section of JSBSim, see `jsbsim_aerodynamics`.

    Args:
        plan: With the draws.
        name: Of the canopies.
        path: Where to.
        draw: Number of the draw as in ``aero_tables.csv``; None: coefficients are their means over all draws.
        steady: Steady descents of all draws, where they are known already.

    Raises:
        InputError: If there is no such draw, the file's name is not one of an XML file, or canopies have no steady
            fly-out angle.
    """
    _fit_for_jsbsim(plan, path, draw)
    known = steady or steady_clusters(plan.models)
    chosen = slice(None) if draw is None else slice(draw, draw + 1)
    parts, first = [], 0
    for one in plan.models:
        here = range(first, first + len(one.theta))
        first = here.stop
        if draw is None or draw in here:
            own = slice(here.start, here.stop) if draw is None else chosen
            some = one if draw is None else _only(one, draw - here.start)
            parts.append(cluster_coefficients(some, known.flyout[own], known.speed[own]))
    coefficients = np.concatenate(parts, axis=2).mean(axis=2)
    notes = {key: float(getattr(known, key)[chosen].mean()) for key in ("reach", "mass", "flyout", "enclosed_volume")}
    area, length = (float(a[chosen].mean()) for a in (known.area, known.length))
    said = f"posterior mean of {plan.draws} draws" if draw is None else f"draw {draw} of {plan.draws}"
    tree = jsbsim_aerodynamics.aerodynamics(name, said, ANGLES, coefficients, area, length, notes)
    jsbsim_aerodynamics.write(tree, path)
    return path


def _fit_for_jsbsim(plan: CampaignPlan, path: Path, draw: int | None) -> None:
    """Refuse a draw that isn't there and a file that JSBSim wouldn't find."""
    faults = []
    whole = isinstance(draw, (int, np.integer)) and not isinstance(draw, bool)
    if draw is not None and not (whole and 0 <= draw < plan.draws):
        faults.append(Fault("to_jsbsim draw", repr(draw), f"a whole number from 0 to {plan.draws - 1}, or None"))
    if path.suffix.lower() != ".xml":
        faults.append(Fault("to_jsbsim path", repr(str(path)), "a name that ends with .xml, which JSBSim looks for"))
    if faults:
        raise InputError(faults)


def _only(one: Parameters, number: int) -> Parameters:
    """A model with one of its draws."""
    return replace(one, theta=one.theta[number : number + 1])


def write_rocketpy(plan: CampaignPlan, name: str, folder: Path, steady: SteadyCluster | None = None) -> Path:
    """Write the numbers of all draws and a module that makes RocketPy's parachutes of them.

    Args:
        plan: With the draws.
        name: Of the parachute.
        folder: Where to.
        steady: Steady descents of all draws, where they are known already.

    Returns:
        The module.

    Raises:
        InputError: If canopies have no steady fly-out angle.
    """
    _, module = rocketpy_parachutes.write(name, steady or steady_clusters(plan.models), folder)
    return module


def write_other_programs(plan: CampaignPlan, name: str, folder: Path, jsbsim_draws: int = 0) -> list[str]:
    """Both, of the mean and, for JSBSim, of the first draws in a folder of its own.

    Args:
        plan: With the draws.
        name: Of the campaign.
        folder: Where to.
        jsbsim_draws: Number of draws that get a file of JSBSim each.

    Returns:
        Why a file was not written, line by line.
    """
    try:
        steady = steady_clusters(plan.models)
    except InputError as error:
        return [f"no files for JSBSim and RocketPy: {fault}" for fault in error.faults]
    write_jsbsim(plan, name, folder / JSBSIM, None, steady)
    write_rocketpy(plan, name, folder, steady)
    wanted = min(jsbsim_draws, plan.draws)
    for draw in range(wanted):
        write_jsbsim(plan, name, folder / "jsbsim" / f"canopies-draw-{draw}.xml", draw, steady)
    return [] if wanted == jsbsim_draws else [f"files for JSBSim of {wanted} draws: the campaign has no more"]
