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
# # From a record to bands and a risk number
#
# A sonde falls under a small parachute. All that is known of the fall is its altitude, once a second, and not without
# error. How fast will it be going at the end of the part that we have not looked at yet, and how sure may we be?
#
# `bayeschute run` does what follows in one command. Here every step is a call of its own, so that each can be looked
# at.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import mkdtemp

import jax
import numpy as np
from numpyro.infer import MCMC, NUTS, init_to_value

import bayeschute as bc
from bayeschute.atmosphere.standard import standard_density

SEED = 1

# %% [markdown]
# ## A record
#
# So that the answer can be compared with the truth, we make the record ourselves: a body with a known $C_D S/m$ at the
# speed where drag and weight balance, in air that rises and sinks by some 0.4 m/s for half a minute at a time. The
# altimeter errs by 0.3 m, and once by 40 m.

# %%
TRUE_DRAG = 0.16  # C_D S/m [m^2/kg]
rng = np.random.default_rng(SEED)
seconds, altitude, rate, gust = 120, np.empty(120), np.empty(120), 0.0
height = 3000.0
for i in range(seconds):
    gust += -gust / 30.0 + 0.4 * np.sqrt(2.0 / 30.0) * rng.standard_normal()
    rate[i] = np.sqrt(2.0 * 9.80665 / (TRUE_DRAG * standard_density(height))) + gust
    altitude[i] = height + 0.3 * rng.standard_normal()
    height -= rate[i]
altitude[40] += 40.0

file = Path(mkdtemp()) / "sonde.csv"
table = np.column_stack([np.arange(seconds), altitude])
np.savetxt(file, table, fmt="%.2f", delimiter=",", header="time_s,altitude_m", comments="")

# %% [markdown]
# ## Reading and cleaning
#
# Columns have units; whatever is dropped or derived is listed. The outlier goes, the descent rate is the slope of the
# altitude, and since the record knows nothing of the air, its density is that of a standard day. Only the first 75 s
# are fitted; the rest is held out.

# %%
raw = bc.read_record(file, {"time": ("time_s", "s"), "altitude": ("altitude_m", "m")})
flight = bc.Flight(raw, name="sonde", rate="1 Hz", identify_until="75 s")
for repair in flight.repairs:
    print(f"{repair.kind:10} {repair.variable:14} {repair.start:5.0f} to {repair.end:3.0f} s  {repair.detail}")

# %% [markdown]
# ## What is believed beforehand
#
# The maker's drag area and mass say 0.13 m²/kg, give or take a factor of 1.5. The residual of the descent rate is white
# noise plus noise that is correlated over some seconds. And the air moves: its vertical speed is an unknown function
# of time, an Ornstein-Uhlenbeck process. Without it the interval would be far too narrow, since samples that share a
# gust would count as independent. What is given of the noise are medians; how strong it is, the record says.

# %%
prior = bc.Prior("cds_over_mass", np.log(0.13), 0.4, logarithmic=True, unit="m^2/kg", source="the maker's data sheet")
noise = bc.noise(
    {
        "descent_rate": {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"},
        "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"},
    }
)

# %% [markdown]
# ## Fit, and draw
#
# `fit` looks for the mode of the marginal posterior (the motion of the air and the first speed integrated out) and for
# the noise parameters. `sample` draws from that posterior, gives every draw noise parameters of its own, and checks fit
# and draws. What it returns is an ArviZ tree and more: it can be saved, and asked about other flights.

# %%
fit = bc.fit(flight, bc.Priors.of(prior), noise=noise, seed=SEED)
posterior = bc.sample(fit, draws=800, chains=4, warmup=100)
drag = posterior["cds_over_mass"].values.ravel()
low, high = np.quantile(drag, [0.05, 0.95])
print(f"C_D S/m: {drag.mean():.4f} m^2/kg, 90 % between {low:.4f} and {high:.4f}; true value {TRUE_DRAG}")
posterior.checks()[["passed", "value", "bound"]]

# %% [markdown]
# ## The same density in numpyro
#
# `numpyro_model` is the density for held noise parameters as a numpyro model: one site per parameter, in its own unit.
# So whatever numpyro offers can be tried on it, here its plain NUTS sampler, beside the sampler's own draws in the
# group `conditional`.

# %%
held = posterior.data["conditional"]["cds_over_mass"].values.ravel()
begin = init_to_value(values={"cds_over_mass": np.array(drag.mean())})
kernel = NUTS(bc.numpyro_model(fit), init_strategy=begin)
plain = MCMC(kernel, num_warmup=50, num_samples=200, progress_bar=False)
plain.run(jax.random.key(SEED))
theirs = np.asarray(plain.get_samples()["cds_over_mass"])
print(f"numpyro: {theirs.mean():.4f} +- {theirs.std():.4f} m^2/kg, ours: {held.mean():.4f} +- {held.std():.4f}")

# %% [markdown]
# ## What the record tells, and what stands in for the drag
#
# The record takes nearly all of the prior's variance away. But a slow gust looks like another drag. Had we known the
# gusts' size and pace exactly, would the answer be much narrower? A short record hardly tells how strong and how slow
# the gusts are, so it is about a third.

# %%
contraction = 1.0 - (np.log(drag).std() / prior.scale) ** 2
told = posterior.identifiability().loc["cds_over_mass"]
share, partner = told["noise_share"], told["noise_partner"]
print(f"taken away from the prior's variance: {contraction:.1%}")
print(f"due to unknown noise parameters: {share:.1%} of the variance; foremost {partner}")

# %% [markdown]
# ## Bands on what was not looked at
#
# Every draw of the drag goes with noise parameters of its own and a draw of the air's motion: as the data have it for
# as long as there are data, and free after that. So the band widens where the data end. The held-out part holds one or
# two independent gusts, so the share that a single flight has inside its band scatters widely about 90 %; only many
# flights can tell whether the bands are honest.

# %%
forecast = posterior.predict(flight)
band, held_out = forecast.band("descent_rate", 0.9), forecast.held_out
inside = (rate >= band["low"].values) & (rate <= band["high"].values)
covered = float(inside[held_out].mean())
print(f"true descent rates of the held-out part inside the 90 % band: {covered:.0%}")

# %%
LIMIT = 11.0  # [m/s]
forecast.plot({"descent_rate": LIMIT})

# %% [markdown]
# ## A risk number
#
# The requirement: no more than 11 m/s at the end. The draws that meet it are counted; the interval says how much of the
# answer is due to the number of draws.

# %%
risk = forecast.probability("descent_rate", statistic="final", at_most=LIMIT)
print(f"P(met) = {risk.met:.3f}, with {risk.confidence:.0%} confidence between {risk.low:.3f} and {risk.high:.3f}")

# %% [markdown]
# One flight says nothing about the next one's air or canopy. `models/studies/dropsondes.toml` fits several drops and
# their population; `bc.Study.example()` does all of this for a capsule under two canopies.
