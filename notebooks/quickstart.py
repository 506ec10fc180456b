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
# `bayeschute run` does what follows in one command. Here every step is a call of a public function, so that each can be
# looked at, and replaced.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import mkdtemp

import jax
import numpy as np
from numpyro.infer import MCMC, NUTS, init_to_value

from bayeschute.atmosphere.standard import standard_density
from bayeschute.likelihood.channels import descent_data
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import numpyro_model
from bayeschute.posterior.assess.identifiability import confounding, noise_parameter_labels
from bayeschute.posterior.fit import find
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.posterior.sampler import data_tree, sample
from bayeschute.prediction import bands
from bayeschute.prediction.requirement import requirement_check
from bayeschute.records.clean import clean
from bayeschute.records.derive import derive
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import repairs
from bayeschute.report.figures.record_figures import band_figure

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
# altitude, and since the record knows nothing of the air, its density is that of a standard day.

# %%
columns = {"time": ColumnSpec("time_s", "s"), "altitude": ColumnSpec("altitude_m", "m")}
record = derive(clean(read_record(file, columns), rate_hz=1.0))
for repair in repairs(record):
    print(f"{repair.kind:10} {repair.variable:14} {repair.start:5.0f} to {repair.end:3.0f} s  {repair.detail}")

# %% [markdown]
# ## What is believed beforehand
#
# The maker's drag area and mass say 0.13 m²/kg, give or take a factor of 1.5. The residual of the descent rate is white
# noise plus noise that is correlated over some seconds. And the air moves: its vertical speed is an unknown function
# of time, an Ornstein-Uhlenbeck process. Without it the interval would be far too narrow, since samples that share a
# gust would count as independent.

# %%
prior = Prior("cds_over_mass", np.log(0.13), 0.4, logarithmic=True, unit="m^2/kg", source="the maker's data sheet")
residual = Noise(white=np.array([0.3]), correlated=np.array([0.3]), time_constant=np.array([3.0]))
noise = NoisePrior(NoiseParameters(residual, laws=(np.array([0.5, 30.0]),)))  # sd [m/s], time constant [s]

# %% [markdown]
# ## Fit
#
# Only the first 75 s are fitted. `find` looks for the optimum and the noise parameters, and how well these are known.
# `sample` draws from the posterior in which the motion of the air and the first speed are integrated out and the noise
# parameters held; `widened` gives every draw noise parameters of its own. The tree has the widened draws as its
# posterior, and the others in the group `conditional`.

# %%
TOLD = 75.0  # [s]
flight = descent_data(record, Latent(("drift",), ((0, 0),)), until=TOLD)
found = find([flight], [prior], noise)
draws = sample(found.marginal, "nuts", chains=4, warmup=100, draws=200, seed=SEED)
wide = widened(draws.xi, found.noise_effect, found.noise_parameter_covariance, SEED)
posterior = data_tree(found.marginal, [prior], draws, SEED, ["sonde"], wide=wide)
drag, held = (posterior[group]["cds_over_mass"].values.ravel() for group in ("posterior", "conditional"))
low, high = np.quantile(drag, [0.05, 0.95])
print(f"C_D S/m: {drag.mean():.4f} m^2/kg, 90 % between {low:.4f} and {high:.4f}; true value {TRUE_DRAG}")

# %% [markdown]
# ## The same density in numpyro
#
# `numpyro_model.model` is the density for held noise parameters as a numpyro model: one site per parameter, in its own
# unit, and JAX gradients all the way through the simulation. So whatever numpyro offers can be tried on it, here its
# plain NUTS sampler. That needs a simulation and its gradient at every leapfrog step, where `sample` walks on a
# surrogate and corrects.

# %%
begin = init_to_value(values=numpyro_model.start(found.marginal, [prior]))
plain = MCMC(
    NUTS(numpyro_model.model(found.marginal, [prior]), init_strategy=begin), num_warmup=50, num_samples=200,
    progress_bar=False,
)  # fmt: skip
plain.run(jax.random.key(SEED))
theirs = np.asarray(plain.get_samples()["cds_over_mass"])
print(f"numpyro: {theirs.mean():.4f} +- {theirs.std():.4f} m^2/kg, ours: {held.mean():.4f} +- {held.std():.4f}")

# %% [markdown]
# ## What the record tells, and what stands in for the drag
#
# The record takes nearly all of the prior's variance away. But a slow gust looks like another drag. Had we known the
# gusts' size and pace exactly, would the answer be much narrower? `confounding` says how much of the variance that
# makes, and which noise parameter goes most with the drag. A short record hardly tells how strong and how slow the
# gusts are, so it is about a third. (The report of `bayeschute run` says such things of every parameter.)

# %%
contraction = 1.0 - (np.log(drag).std() / prior.scale) ** 2
names = noise_parameter_labels(["descent rate"], ["wind"], ["drift"])
mixed = confounding(
    np.asarray(found.marginal.scale), found.noise_effect, found.noise_parameter_covariance, [prior], names
)
(partner, correlation), share = mixed.strongest()["cds_over_mass"], mixed.share[0]
print(f"taken away from the prior's variance: {contraction:.1%}")
print(f"due to unknown noise parameters: {share:.1%} of the variance; foremost {partner} ({correlation:.2f})")

# %% [markdown]
# ## Bands on what was not looked at
#
# Every draw of the drag goes with noise parameters of its own (`carried` says what they do to it) and a draw of the
# air's motion: as the data have it for as long as there are data, and free after that. So the band widens where the
# data end. The held-out part holds one or two independent gusts, so the share that a single flight has inside its band
# scatters widely about 90 %; only many flights can tell whether the bands are honest.

# %%
laws = bands.noise_parameter_draws(found.hyper, found.noise_parameter_covariance, 32, np.random.default_rng(SEED))
theta = bands.carried(found.marginal, np.log(held)[:, None], laws, found.noise_effect)
prediction = bands.predict(found.marginal, 0, theta, laws, SEED, told=TOLD)
time = record["time"].values
held_out = time > TOLD
seen = {"descent_rate": record["descent_rate"].values}
made = bands.dataset(prediction, time, ["descent_rate"], None, seen, held_out, "predict")
covered = bands.coverage(prediction.draws["descent_rate"], rate, held_out)
print(f"true descent rates of the held-out part inside the 90 % band: {covered:.0%}")

# %%
LIMIT = 11.0  # [m/s]
band_figure(made, {"descent_rate": LIMIT})

# %% [markdown]
# ## A risk number
#
# The requirement: no more than 11 m/s at the end. The draws that meet it are counted; the interval says how much of the
# answer is due to the number of draws.

# %%
risk = requirement_check(
    prediction.draws["descent_rate"][:, -1],
    name="speed at the end",
    quantity="descent_rate",
    unit="m/s",
    at_most=LIMIT,
)
print(f"P(met) = {risk['probability_met']:.3f}, with {risk['confidence']:.0%} confidence between")
print(f"{risk['simulation_low']:.3f} and {risk['simulation_high']:.3f}; median {risk['median']:.2f} m/s")

# %% [markdown]
# One flight says nothing about the next one's air or canopy. `models/studies/dropsondes.toml` fits several drops and
# their population; `models/studies/cdt-3-11.toml` does all of this for a capsule under two canopies.
