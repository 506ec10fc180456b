# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Down to the ground: a limit, the day's wind, and the next drop
#
# One drop of a capsule under two canopies was recorded. Does it land softly enough, nine times in ten, and are we sure?
# What drives that? On which days may it be released? And which drop, with which instruments, would tell most?

# %%
# %matplotlib inline
import os
from pathlib import Path
from tempfile import mkdtemp

import bayeschute as bc

SMALL = bool(os.environ.get("BAYESCHUTE_SMALL"))  # for a test of this notebook: not for use
study = bc.Study.example()
flight, candidates = study.flights["cdt-3-11"], study.candidates
if SMALL:
    flight = flight.changed(window=(0.0, 25.0))
    few = {"axial": ("1", "alpha^2"), "transverse": ("e", "e*alpha^2", "rate"), "fit": "pool"}
    candidates = candidates.model_copy(update=few)

# %%
priors = bc.Priors.from_structure(bc.select_structure(flight, candidates)) | study.priors
posterior = bc.sample(bc.fit([flight], priors, noise=study.noise), draws=400 if SMALL else 2000, seed=1)
posterior

# %% [markdown]
# ## Landings, and the requirement
#
# Winds by altitude, each as likely as the other, may be off by some feet per second, and may have a layer of shear.
# Every landing has a wind, a start, gusts and a draw of the parameters of its own. Nine in ten shall touch down at
# 36 ft/s at most, reduced to sea level, and we want to be sure of that to 90 %.

# %%
altitudes = [0.0, 800.0, 1500.0]  # [m]
winds = {
    "profile": [
        bc.wind_profile(altitudes, north=[1.5, 4.0, 6.0], east=[0.5, 1.5, -2.0]),
        bc.wind_profile(altitudes, north=[-1.0, -3.0, -1.0], east=[2.0, 4.0, 7.0]),
    ],
    "error_sd": "3 ft/s",
    "shear": [{"middle": "1200 ft", "thickness": "300 ft", "north": "10 ft/s", "probability": 0.3}],
}
limit = {"quantity": "sea_level_vertical_speed", "at_most": "32 ft/s" if SMALL else "36 ft/s"}
landings = posterior.land(
    winds=winds,
    draws=256 if SMALL else 8192,
    start={"altitude": "150 m" if SMALL else "1200 m"},
    requirement=[{"name": "soft enough", "limits": [limit], "probability": 0.9, "confidence": 0.9}],
)
landings

# %%
(judged,) = landings.judgements()
print(judged.verdict.verdict, "-", judged.verdict.why)
landings.plot("sea_level_vertical_speed")

# %% [markdown]
# ## What drives it?
#
# Total shares of the variance of the touchdown speed: what would vanish on average if all but that were known. They
# overlap. A swinging capsule lands at some phase of its swing, and parameters, gusts and start decide on that together.

# %%
driven = landings.sensitivity(32 if SMALL else 256)
driven.plot("sea_level_vertical_speed")

# %% [markdown]
# ## On which days?
#
# The wind's change across a layer 250 m over the ground, by payload: how likely the cluster swings as a pendulum at
# touchdown, and whether the requirement is met.

# %%
shears, payloads = ["0 ft/s", "15 ft/s", "30 ft/s"], ["18000 lb", "20860 lb", "23000 lb"]
if SMALL:
    shears, payloads = shears[::2], payloads[1:2]
placard = landings.placard(shear=shears, capsule_mass=payloads, middle="250 m", landings=64 if SMALL else 512)
placard.plot()

# %% [markdown]
# ## Which drop next?
#
# Six candidates: longer, shorter, calm and light, in rough air, with finer positions of the canopies, with a second
# wind sounding. The file says how each would be flown and recorded. Each is flown virtually, and its record analysed
# with today's posterior as the prior.

# %%
folder = Path(mkdtemp())
bc.copy_templates(folder)
file = folder / "candidate-drops.toml"
if SMALL:
    text = file.read_text().replace('"60 s"', '"10 s"').replace('"120 s"', '"10 s"').replace('"25 s"', '"10 s"')
    file.write_text("[[flight]]".join(text.split("[[flight]]")[:3]))
ranking = landings.rank_drops(file)
ranking.plot()

# %%
ranking

# %% [markdown]
# ## The finding

# %%
chance, best = judged.chance, ranking.table.iloc[0]
shares = driven.table[driven.table["quantity"] == "sea_level_vertical_speed"].pivot(
    index="source", columns="kind", values="share"
)
alone, together = shares.loc["parameters", ["first", "total"]]
interval = f"{chance.low:.3f} to {chance.high:.3f} over the posterior"
print(f"P(soft enough) = {chance.met:.3f}, {interval}: {judged.verdict.verdict}.")
print(
    f"Of the touchdown speed's variance the parameters make {alone:.0%} alone, {together:.0%} with what they act with."
)
print(f"The next drop to fly is {best.candidate!r}: it would shrink our doubt about P by {best.shrinking:.0%}.")
