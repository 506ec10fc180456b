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
# # Your own record: from a logger's units and signs to a report
#
# A logger writes what its maker likes: milliseconds, feet, inches of mercury, a rate of *climb*. This notebook brings
# such a log into the package, makes the mistakes that one makes, and asks which of them the package catches and what
# the others cost.

# %%
# %matplotlib inline
import os
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pandas as pd

import bayeschute as bc
from bayeschute.atmosphere.standard import standard_density

SMALL = bool(os.environ.get("BAYESCHUTE_SMALL"))
FOLDER = Path(mkdtemp())

# %% [markdown]
# ## The log
#
# We make one up, so that the truth is known: a sonde of $C_D S/m$ = 0.16 m²/kg on a day on which the air is 4 % thinner
# than standard, with a jump of the altimeter and ten seconds without data.

# %%
TRUE_DRAG, THIN = 0.16, 0.96
rng = np.random.default_rng(2)
seconds = 100 if SMALL else 180
height, gust, rows = 3000.0, 0.0, []
for second in range(seconds):
    gust += -gust / 30.0 + 0.4 * np.sqrt(2.0 / 30.0) * rng.standard_normal()
    density = THIN * float(standard_density(height))
    rate = np.sqrt(2.0 * 9.80665 / (TRUE_DRAG * density)) + gust
    altitude = height + 0.3 * rng.standard_normal()
    climb = -rate + 0.3 * rng.standard_normal()
    rows.append((1000 * second, altitude / 0.3048, climb / 0.3048 * 60.0, density))
    height -= rate
log = pd.DataFrame(rows, columns=["ms", "alt_ft", "climb_fpm", "rho"])
log.loc[30, "alt_ft"] += 130.0
log.loc[50:59, "alt_ft"] = np.nan
log.to_csv(FOLDER / "logger.csv", index=False)
log.head(3)

# %% [markdown]
# ## A wrong map is refused, with every fault at once

# %%
try:
    bc.read_record(FOLDER / "logger.csv", {"time": ("ms", "Pa"), "altitude": ("alt_ft", "kg"), "hight": ("rho", "1")})
except bc.InputError as error:
    print(error)
    faults = len(error.faults)

# %% [markdown]
# ## Units convert, signs are said
#
# `"ms"` and `"ft"` are enough. The rate of climb must become a rate of descent: a gain of minus one in the column's
# entry. Whoever forgets it has a body that falls upwards; `bayeschute check` and every fit refuse it.

# %%
columns = {
    "time": ("ms", "ms"),
    "altitude": ("alt_ft", "ft"),
    "descent_rate": ("climb_fpm", "ft/min", -1.0),
    "density": ("rho", "kg/m^3"),
}
record = bc.read_record(FOLDER / "logger.csv", columns)
flight = bc.Flight(record, name="with density", rate="1 Hz", identify_until="65 %")
print(flight.repairs)
flight.plot()

# %% [markdown]
# ## What does a missing column cost?
#
# Without the recorded density the package takes that of a standard day, and says so. Nothing is wrong with the file, so
# nothing can be refused: the estimate is off by as much as the air.

# %%
few = {name: columns[name] for name in ("time", "altitude", "descent_rate")}
blind = bc.Flight(bc.read_record(FOLDER / "logger.csv", few), name="standard day", rate="1 Hz", identify_until="65 %")
prior = bc.Prior("cds_over_mass", np.log(0.13), 0.4, logarithmic=True, unit="m^2/kg", source="data sheet")
noise = bc.noise(
    {
        "descent_rate": {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"},
        "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"},
    }
)
found = {}
for one in (flight, blind):
    posterior = bc.sample(bc.fit(one, bc.Priors.of(prior), noise=noise), draws=2000, warmup=200, seed=1)
    found[one.name] = posterior["cds_over_mass"].values.ravel()
    low, high = np.quantile(found[one.name], [0.05, 0.95])
    print(f"{one.name:13} C_D S/m = {found[one.name].mean():.4f} ({low:.4f} to {high:.4f}) m^2/kg; true {TRUE_DRAG}")

# %% [markdown]
# ## To a report
#
# The same as a study file, which `bayeschute run` takes as well.

# %%
(FOLDER / "mine.toml").write_text("""
title = "A sonde from a logger"
model = "descent"
seed = 1
[columns]
time = { column = "ms", unit = "ms" }
altitude = { column = "alt_ft", unit = "ft" }
descent_rate = { column = "climb_fpm", unit = "ft/min", scale = -1.0 }
density = { column = "rho", unit = "kg/m^3" }
[[flight]]
name = "sonde"
file = "logger.csv"
roles = ["identify", "predict"]
rate = "1 Hz"
identify_until = "65 %"
[priors.given]
cds_over_mass = { median = "0.13 m^2/kg", log_sd = 0.4 }
[noise]
descent_rate = { white = "0.3 m/s", correlated = "0.3 m/s", time_constant = "3 s" }
[noise.wind]
vertical = "0.5 m/s"
time_constant = "30 s"
[[requirement]]
name = "descent rate at the end"
quantity = "descent_rate"
statistic = "final"
at_most = "11 m/s"
""")
print(len(bc.check_study(FOLDER / "mine.toml")), "faults")
run = bc.run(bc.Study.load(FOLDER / "mine.toml"), FOLDER / "run", quick=SMALL)
report = FOLDER / "run" / "report.html"
print(report.name, f"{report.stat().st_size / 1024:.0f} kB")

# %% [markdown]
# ## The finding
#
# Wrong units and names are refused. A missing density is not: it moves the estimate by the error of the air, here by
# most of a standard deviation. If the descent rate is predicted for the same day the error cancels; for another day it
# does not. So: record pressure and temperature.

# %%
shift = found["standard day"].mean() / found["with density"].mean() - 1.0
in_sd = abs(found["standard day"].mean() - found["with density"].mean()) / found["with density"].std()
print(f"The standard day moves C_D S/m by {shift:+.1%}, {in_sd:.1f} standard deviations, without a warning of the fit.")
