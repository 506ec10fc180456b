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
# # Predicting, and checking the prediction
#
# A prediction is made to be checked. One drop is fitted; others, which the fit never saw, are predicted from their
# first seconds and compared with what they did. Then the air changes.

# %%
# %matplotlib inline
import os
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import bayeschute as bc
from bayeschute.atmosphere.standard import standard_density

OTHERS = 4 if os.environ.get("BAYESCHUTE_SMALL") else 30
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


# %% [markdown]
# ## Fit one drop

# %%
rng = np.random.default_rng(3)
prior = bc.Prior("cds_over_mass", np.log(0.13), 0.4, logarithmic=True, unit="m^2/kg", source="data sheet")
noise = bc.noise(
    {
        "descent_rate": {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"},
        "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"},
    }
)
first, _ = drop("first", rng)
posterior = bc.sample(bc.fit(first, bc.Priors.of(prior), noise=noise), draws=1200, warmup=200, seed=1)
posterior

# %% [markdown]
# ## Predict another, and look
#
# Its first five seconds give the initial state; from there the air is drawn afresh.

# %%
second, _ = drop("second", rng)
forecast = posterior.predict(second, draws=400)
forecast.plot()

# %%
forecast.check()

# %% [markdown]
# One flight says little: its 95 s hold a few independent gusts, so the share inside a perfect 90 % band scatters
# widely.
#
# ## Many others, in calm, like and rough air
#
# The share of the true descent rates inside the 90 % band, over drops. `disturbance_log_sd` lets the air of a predicted
# flight be rougher or calmer than that of the fit, by a log-normal factor: here of two either way.


# %%
def shares(gusts, factor):
    """Share of each drop's true rates in its 90 % band, for drops in air of a given roughness."""
    rng, found = np.random.default_rng(7), []
    for i in range(OTHERS):
        flight, truth = drop(f"other {i}", rng, gusts=gusts)
        band = posterior.predict(flight, draws=200, seed=i, disturbance_log_sd=factor).band("descent_rate", 0.9)
        at = band["time"].values.astype(int)
        inside = (truth[at] >= band["low"].values) & (truth[at] <= band["high"].values)
        found.append(inside[10:].mean())  # after the opening
    return np.array(found)


coverage = {}
for words, gusts in (("calmer", 0.2), ("like", 0.4), ("rougher", 0.8)):
    for name, factor in (("as fitted", 0.0), ("with a factor", 0.7)):
        found = shares(gusts, factor)
        coverage[words, name] = float(found.mean())
        error = found.std(ddof=1) / np.sqrt(found.size)
        print(f"{words:8} air, disturbances {name:14} {found.mean():4.0%} +- {error:.0%} inside the 90 % band")

# %% [markdown]
# ## The finding
#
# In air like that of the fit, or calmer, the bands hold what they promise, or more. In rougher air they hold less, and
# no check of the *fit* can say so: the new air is not in the record. A stated belief about it widens the bands; a
# record of it, such as a sounding, is better.

# %%
loss = coverage["like", "as fitted"] - coverage["rougher", "as fitted"]
gain = coverage["rougher", "with a factor"] - coverage["rougher", "as fitted"]
print(f"Gusts twice as strong cost {loss:.0%} of coverage; allowing for other air gives {gain:+.0%} back.")
