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
# # Quick start: from a study file to a band, in a dozen lines
#
# A capsule of ten tonnes descends under two canopies and swings. One drop was recorded; the next has another payload
# and another wind. Will its mean descent rate, reduced to sea level, stay below 33 ft/s, and how much would a further
# drop help to say so?

# %%
# %matplotlib inline
import os

import bayeschute as bc

study = bc.Study.example()  # or bc.Study.load("mine/cluster.toml"); the flights are simulated, so the truth is known
flight, following = study.flights["cdt-3-11"], study.flights["cdt-3-12"]
study

# %% [markdown]
# For a test of this notebook the records are cut and few terms are offered (`BAYESCHUTE_SMALL=1`): not for use.

# %%
candidates, draws = study.candidates, 2000
if os.environ.get("BAYESCHUTE_SMALL"):
    flight, following = flight.changed(window=(0.0, 25.0)), following.changed(window=(0.0, 25.0))
    few = {"axial": ("1", "alpha^2"), "transverse": ("e", "e*alpha^2", "rate"), "fit": "pool"}
    candidates, draws = candidates.model_copy(update=few), 400

# %%
structure = bc.select_structure(flight, candidates)
priors = bc.Priors.from_structure(structure) | study.priors
posterior = bc.sample(bc.fit([flight], priors, noise=study.noise), draws=draws, seed=1)
forecast = posterior.predict(following, draws=400 if draws > 400 else 100)

# %%
forecast.plot()

# %%
risk = forecast.probability("sea_level_descent_rate", statistic="mean", at_most="33 ft/s")
risk

# %%
shares = forecast.shares["sea_level_descent_rate"]
for source, share in sorted(shares.items(), key=lambda one: -one[1]):
    print(f"{source:15} {share:.0%} of the variance")

# %% [markdown]
# ## The finding
#
# The probability above, with its interval, is the answer. The shares say what would change it. What comes from the
# parameters a further drop can reduce. What comes from the wind it can not: that is the air of the day, and only a
# forecast of it, or a limit with a margin for it, helps.

# %%
reducible = shares["parameter"]
print(f"The limit is met with P = {risk.met:.3f} ({risk.low:.3f} to {risk.high:.3f} by the number of draws).")
print(f"Perfect knowledge of the coefficients would narrow the band by {1 - (1 - reducible) ** 0.5:.0%} at most.")
