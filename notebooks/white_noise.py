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
# # Why white noise lies: an experiment
#
# Least squares on residuals that are taken for white noise is the usual way from a record to a standard error. Here it
# is compared, over many made-up drops, with a model in which gusts are what they are: a disturbance of the motion that
# lasts. The true $C_D S/m$ is known, so we can count.

# %%
# %matplotlib inline
import os
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import bayeschute as bc
from bayeschute.atmosphere.standard import standard_density

DROPS = 5 if os.environ.get("BAYESCHUTE_SMALL") else 40
TRUE_DRAG, FOLDER = 0.16, Path(mkdtemp())

# %% [markdown]
# ## The drops
#
# A sonde at its terminal velocity in gusts of 0.4 m/s over half a minute; altitude once a second for 100 s.


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
# ## Two models of the same noise
#
# White: every second is new information. Latent: an Ornstein-Uhlenbeck process moves the air, and within half a minute
# it says the same thing again. The prior and everything else are the same.

# %%
models = {
    "white": bc.noise({"model": "white", "descent_rate": {"kind": "white", "white": "0.3 m/s"}}),
    "latent": bc.noise(
        {
            "descent_rate": {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"},
            "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"},
        }
    ),
}
prior = bc.Prior("cds_over_mass", np.log(0.13), 0.4, logarithmic=True, unit="m^2/kg", source="data sheet")
rng, intervals = np.random.default_rng(0), {name: [] for name in models}
for i in range(DROPS):
    flight, _ = drop(f"drop {i}", rng)
    for name, noise in models.items():
        posterior = bc.sample(bc.fit(flight, bc.Priors.of(prior), noise=noise), draws=400, warmup=100, seed=i)
        intervals[name].append(np.quantile(posterior["cds_over_mass"].values, [0.05, 0.5, 0.95]))

# %%
figure, panels = plt.subplots(1, 2, figsize=(9.6, 3.6), sharex=True, sharey=True, layout="constrained")
held, width = {}, {}
for axes, (name, rows) in zip(panels, intervals.items(), strict=True):
    low, middle, high = np.array(rows).T
    inside = (low <= TRUE_DRAG) & (high >= TRUE_DRAG)
    held[name], width[name] = float(inside.mean()), float(np.median(high - low))
    colors = np.where(inside, "#0072B2", "#D55E00")
    axes.hlines(np.arange(DROPS), low, high, colors=colors)
    axes.plot(middle, np.arange(DROPS), "k.", ms=3)
    axes.axvline(TRUE_DRAG, color="k", lw=0.8)
    axes.set(title=f"{name}: {inside.sum()} of {DROPS} 90 % intervals hold the truth", xlabel="C_D S/m [m^2/kg]")
_ = panels[0].set_ylabel("drop")

# %% [markdown]
# ## Why
#
# With correlation time $\tau$ and samples every $\Delta t$, $N$ samples are worth about $N \Delta t/(2\tau)$
# independent ones: 100 s in gusts of 30 s hold one or two. The white model divides by $\sqrt{N}$ instead.

# %%
factor = width["latent"] / width["white"]
print(f"expected ratio of widths, from the correlation time: about {np.sqrt(2.0 * 30.0 / 1.0):.0f}")

# %% [markdown]
# ## The finding
#
# A model with white noise is not somewhat optimistic; it is wrong by the square root of the number of samples per
# correlation time, and more data at the same rate make it worse.

# %%
print(f"90 % intervals held the truth in {held['white']:.0%} (white) and {held['latent']:.0%} (latent) of the drops")
print(f"the honest intervals are {factor:.0f} times as wide")
