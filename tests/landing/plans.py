"""A cluster with scattered parameters to land, without a fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.landing.campaign_plan import CampaignPlan, Parameters
from bayeschute.landing.landing_model import LandingFlight, density_law
from bayeschute.landing.start_plan import StartPlan
from bayeschute.landing.wind_plan import Profile, WindPlan
from bayeschute.study.assembly import assemble
from bayeschute.study.load import load_study

ROOT = Path(__file__).parents[2]


def small_plan() -> CampaignPlan:
    """Twelve draws, a wind that turns, from 400 m over the ground."""
    study = load_study(ROOT / "models/studies/cdt-3-11.toml")
    base, structure = assemble.cluster(study.vehicle)
    known = study.vehicle.aero.coefficients()
    centre = np.array(list(known.values()))
    theta = centre * (1.0 + 0.03 * np.random.default_rng(0).standard_normal((12, centre.size)))
    laws = tuple(np.tile(np.asarray(law, float), (12, 1)) for law in assemble.hyper(study).disturbance_parameters)
    blank = replace(base, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    model = Parameters(blank, structure, tuple(known), theta, assemble.latent(study, 2), laws)
    wind = Profile(np.array([0.0, 300.0, 900.0]), np.array([[2.0, 0.0, 0.0], [5.0, 1.0, 0.0], [6.0, -3.0, 0.0]]))
    start = StartPlan((700.0, 10.0), swing=(0.0, 0.1), swing_rate=(0.0, 0.02), tilt=0.03, body_rate=0.02)
    return CampaignPlan((model,), start, WindPlan((wind,), error_sd=0.5), ground=300.0, contact=2.0, seed=3)


def small_model(one: Parameters) -> LandingFlight:
    """The model of some draws between -500 m and 1500 m, 0.2 s between samples."""
    law, middle, half = density_law(-500.0, 1500.0)
    return LandingFlight(one.base, law, middle, half, 0.2 * np.arange(6), 0.2, one.structure, one.names, Stepping(6))


def single(one: Parameters) -> Parameters:
    """The draws with one canopy, which has no neighbour."""
    structure = replace(one.structure, canopies=1, transverse=one.structure.transverse[:3])
    blank = replace(one.base, transverse=one.base.transverse[:3])
    return replace(one, structure=structure, base=blank, names=one.names[:5], theta=one.theta[:, :5])
