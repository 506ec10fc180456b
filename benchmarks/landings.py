"""Landings of the default cluster to the ground: time, memory, the same rows for one process and for several.

Draws of the parameters are the vehicle's coefficients with a few per cent of scatter, disturbances those of the default
study, winds those of the example campaign. The whole campaign is flown by the workers; some batches are flown again in
this process, and must be the same to the last bit. ``--landings 100000 --workers 2`` is the number to reach: 300 s.
"""

from __future__ import annotations

import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from command import parser_of, print_result

from bayeschute.core.numerics import processors
from bayeschute.core.random import stream
from bayeschute.landing.campaign_plan import CampaignPlan, Parameters
from bayeschute.landing.fly_landings import BATCH
from bayeschute.study.assembly import assemble
from bayeschute.study.landing_campaign.campaign_file import load_campaign, wind_plan
from bayeschute.study.landing_campaign.landing_plan import start_plan
from bayeschute.study.landing_campaign.landing_rows import Part, fly_campaign, fly_part
from bayeschute.study.load import load_study

ROOT = Path(__file__).parents[1]
BOUND = 300.0  # [s] for 100,000 landings on two cores


def plan_of_default(draws: int = 200) -> CampaignPlan:
    """Landings of the default study's vehicle, its parameters scattered about the vehicle's."""
    study = load_study(ROOT / "models/studies/cdt-3-11.toml")
    campaign = load_campaign(ROOT / "models/campaigns/cdt-3-11-landing.toml").tables
    assert study.vehicle is not None
    base, structure = assemble.cluster(study.vehicle)
    known = study.vehicle.aero.coefficients()
    names = (*known, "riser_stiffness", "riser_damping", "riser_length")
    risers = study.vehicle.risers
    centre = np.array([*known.values(), np.log(risers.stiffness), np.log(risers.damping), risers.length])
    sd = np.array([*(0.03 * abs(v) + 0.005 for v in known.values()), 0.1, 0.1, 0.1])
    theta = centre + sd * stream(1, "draws of a benchmark").standard_normal((draws, sd.size))
    laws = tuple(np.tile(np.asarray(law, float), (draws, 1)) for law in assemble.hyper(study).disturbance_parameters)
    blank = replace(base, axial=(0.0,) * len(structure.axial), transverse=(0.0,) * len(structure.transverse))
    latent = assemble.latent(study, structure.canopies)
    model = Parameters(blank, structure, names, theta, latent, laws)
    start, winds = start_plan(campaign.start), wind_plan(campaign.wind)
    return CampaignPlan((model,), start, winds, campaign.ground.altitude, campaign.ground.contact_height,
                        campaign.canopy_sd, campaign.seed)  # fmt: skip


def main() -> None:
    """Fly, compare, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--landings", type=int, default=8 * BATCH)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    plan = plan_of_default()
    began = time.perf_counter()
    rows = fly_campaign(plan, given.landings, workers=given.workers)
    wall = time.perf_counter() - began
    children, own = (resource.getrusage(who) for who in (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF))
    cpu = sum(use.ru_utime + use.ru_stime for use in (children, own))
    peak = max(children.ru_maxrss * given.workers, own.ru_maxrss) / 1024.0**2
    again = fly_part(Part(0, min(BATCH, given.landings)), plan)
    same = again.tobytes() == rows[: len(again)].tobytes()
    scale = 1e5 / given.landings
    print(f"{given.landings} landings, {int((rows['outcome'] != 0).sum())} failed, {given.workers} workers")
    print(
        f"wall {wall:.0f} s, processor {cpu:.0f} s; 100,000 landings: wall {scale * wall:.0f} s (bound {BOUND:.0f} s)"
    )
    print(f"memory: at most {peak:.2f} GiB in all; rows of one process the same to the bit: {same}")
    ratios = {"landings_wall_time_ratio": scale * wall / BOUND, "landings_cpu_time_ratio": scale * cpu / 2 / BOUND}
    context = {"processors": processors(), "workers": given.workers, "peak_gib": peak, "same": same}
    print_result(given, ratios, context)


if __name__ == "__main__":
    main()
