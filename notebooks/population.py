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
# # A population of drops
#
# Eight dropsondes of one kind were dropped and recorded by others. They are alike, not equal. What will the next one
# do, of which nothing is known but its kind? The records are not part of the project: `BAYESCHUTE_DATA` names their
# folder, which has `dropsonde/*.csv.gz` in it. Without it this notebook says so and stops early.

# %%
# %matplotlib inline
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import bayeschute as bc

SMALL = bool(os.environ.get("BAYESCHUTE_SMALL"))
data = Path(os.environ.get("BAYESCHUTE_DATA") or "no-folder") / "dropsonde"
files = sorted(data.glob("D*.csv.gz"))[: 3 if SMALL else None]
print(f"{len(files)} records of {data.name}s")
if not files:
    print(f"Set BAYESCHUTE_DATA to a folder with {data.name}/")

# %% [markdown]
# ## Records
#
# GPS altitude, with pressure and temperature for the density. The mass is unknown, so only $C_D S/m$ can be found.

# %%
columns = {
    "time": ("time_s", "s"),
    "altitude": ("gpsalt_m", "m"),
    "pressure": ("pres_hPa", "hPa"),
    "temperature": ("tdry_C", "degC"),
}
window = ("40 s", "280 s") if SMALL else ("40 s", "400 s")
flights = [
    bc.Flight(bc.read_record(file, columns), name=file.name.split(".")[0], rate="1 Hz", window=window) for file in files
]
for flight in flights:
    print(flight, f"{len(flight.repairs)} repairs")

# %% [markdown]
# ## Each alone, and their population
#
# Every drop is fitted by itself, with the vertical motion of its air as a latent process. Then the logarithms of the
# drops are members of a normal population, whose mean and standard deviation are drawn with them.

# %%
prior = bc.Prior("cds_over_mass", np.log(0.15), 0.5, logarithmic=True, unit="m^2/kg", source="kind of sonde")
noise = bc.noise(
    {
        "descent_rate": {"white": "0.4 m/s", "correlated": "0.4 m/s", "time_constant": "3 s"},
        "wind": {"vertical": "0.5 m/s", "time_constant": "40 s"},
    }
)
members, mean, spread = {}, np.array([np.nan]), np.array([np.nan])
if flights:
    fit = bc.fit(flights, bc.Priors.of(prior), noise=noise)
    posterior = bc.sample(fit, draws=400 if SMALL else 2000, warmup=100, seed=1)
    members = {n: posterior[n].values.ravel() for n in posterior.names if n.startswith("cds_over_mass[")}
    mean, spread = (posterior[n].values.ravel() for n in ("population_mean", "population_sd"))

# %%
figure, axes = plt.subplots(figsize=(8.0, 3.6), layout="constrained")
for i, (name, draws) in enumerate(members.items()):
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
    axes.plot([low, high], [i, i], color="#0072B2")
    axes.plot(middle, i, "k.")
    axes.text(high, i, "  " + name[len("cds_over_mass[") : -1], va="center", fontsize=8)
coming = np.exp(mean + spread * np.random.default_rng(1).standard_normal(mean.size))
axes.plot(np.quantile(coming, [0.05, 0.95]), [-1, -1], color="#D55E00", lw=3)
_ = axes.set(
    xlabel="C_D S/m [m^2/kg]", yticks=[], title="90 % intervals of each drop, and of the next one of its kind (red)"
)

# %% [markdown]
# ## The finding
#
# The next sonde of the kind is less certain than any that was recorded, by the spread of the population; and with few
# members that spread itself is uncertain. A prediction that takes the mean of the drops for the next one is too narrow
# by the factor below.

# %%
if members:
    one = np.median([np.ptp(np.quantile(d, [0.05, 0.95])) for d in members.values()])
    factor = float(np.ptp(np.quantile(coming, [0.05, 0.95])) / np.ptp(np.quantile(np.exp(mean), [0.05, 0.95])))
    low, high = np.quantile(spread, [0.05, 0.95])
    print(f"population sd of log C_D S/m: {np.median(spread):.3f} ({low:.3f} to {high:.3f})")
    print(f"The next sonde's interval is {factor:.1f} times that of the population's mean.")
else:
    factor = float("nan")
    print("No records, no finding.")
