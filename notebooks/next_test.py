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
# # A limit, and whether another test would help
#
# One drop was flown, and a requirement limits the mean descent rate of the next. How sure is it, how much of the doubt
# is ours (the coefficient) and how much the air's, and what would a second drop add?

# %%
# %matplotlib inline
import os
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import bayeschute as bc
from bayeschute.atmosphere.standard import standard_density

SMALL = bool(os.environ.get("BAYESCHUTE_SMALL"))
WORLDS = 2 if SMALL else 8
FOLDER = Path(mkdtemp())


# %%
def drop(name, rng, gusts=0.4, drag=0.16, seconds=100):
    """The record of a made-up sonde, and its true descent rate [m/s]; `gusts` is the air's standard deviation [m/s]."""
    height, gust, altitude, rate = 3000.0, 0.0, np.empty(seconds), np.empty(seconds)
    for i in range(seconds):
        gust += -gust / 30.0 + gusts * np.sqrt(2.0 / 30.0) * rng.standard_normal()
        rate[i] = np.sqrt(2.0 * 9.80665 / (drag * standard_density(height))) + gust
        altitude[i] = height + 0.3 * rng.standard_normal()
        height -= rate[i]
    file = FOLDER / f"{name}.csv"
    np.savetxt(file, np.column_stack([np.arange(seconds), altitude]), delimiter=",", header="t,h", comments="")
    return bc.Flight(bc.read_record(file, {"time": ("t", "s"), "altitude": ("h", "m")}), name=name, rate="1 Hz"), rate


# %%
rng = np.random.default_rng(5)
prior = bc.Prior("cds_over_mass", np.log(0.13), 0.4, logarithmic=True, unit="m^2/kg", source="data sheet")
noise = bc.noise(
    {
        "descent_rate": {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"},
        "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"},
    }
)
first, _ = drop("first", rng)
posterior = bc.sample(bc.fit(first, bc.Priors.of(prior), noise=noise), draws=1200, warmup=200, seed=1)
following, _ = drop("following", rng)

# %% [markdown]
# ## The probability, limit by limit
#
# A single number hides how sharp the answer is. Where the curve is steep, small things decide.

# %%
forecast = posterior.predict(following, draws=800)
limits = np.linspace(9.5, 12.5, 25)
met = [forecast.probability("descent_rate", statistic="mean", at_most=limit) for limit in limits]
figure, axes = plt.subplots(figsize=(7.2, 3.4), layout="constrained")
axes.fill_between(limits, [m.low for m in met], [m.high for m in met], alpha=0.25)
axes.plot(limits, [m.met for m in met])
_ = axes.set(xlabel="limit on the mean descent rate [m/s]", ylabel="P(met)")

# %% [markdown]
# ## Whose doubt is it?
#
# Shares of the variance of the descent rate along the flight: what would vanish if a source were known.

# %%
shares = forecast.shares["descent_rate"]
for source, share in sorted(shares.items(), key=lambda one: -one[1]):
    print(f"{source:15} {share:.0%} of the variance")

# %% [markdown]
# ## What would a second drop add?
#
# It has not been flown. So it is imagined, several times: a coefficient from today's posterior, a record made with it,
# and the posterior updated by that record. What shrinks on average is what the test is worth.

# %%
draws = posterior["cds_over_mass"].values.ravel()
worth = []
for i in range(WORLDS):
    imagined, _ = drop(f"imagined {i}", np.random.default_rng(100 + i), drag=float(rng.choice(draws)))
    updated = posterior.update([imagined], noise=noise, draws=600, chains=4, warmup=100, seed=i)
    after = float(updated["cds_over_mass"].std())
    rate = updated.predict(following, draws=300, seed=i).statistic("descent_rate", "mean")
    worth.append((after / draws.std(), float(rate.std())))
narrower, spread = np.mean(worth, axis=0)
before = float(forecast.statistic("descent_rate", "mean").std())

# %% [markdown]
# ## The finding
#
# The coefficient gets surer with every drop. The next flight's descent rate does not: it is the air's, and how rough
# the air is begins anew with every record, so that the spread below moves with each estimate of the gusts. If the limit
# lies where the curve above is steep, measure the air or move the limit; another drop of the same canopy is not what is
# missing.

# %%
print(f"A second drop makes the coefficient's sd {narrower:.0%} of today's,")
print(f"and the sd of the next flight's mean descent rate {spread:.2f} m/s, from {before:.2f} m/s.")
print(f"Even a coefficient known exactly leaves {np.sqrt(1.0 - shares['parameter']):.0%} of the band.")
