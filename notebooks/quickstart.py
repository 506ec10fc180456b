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
# A sonde descends under a small parachute. The data are its altitude, once a second, with measurement error. What is
# its rate of descent at the end of the part that is not fitted, and how uncertain is it?
#
# `bayeschute run` does what follows in one command. Here every step is a separate call, so that its result can be
# inspected.

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
# So that the result can be compared with the truth, we simulate the record: a body with a known $C_D S/m$ at its
# terminal velocity, in air with vertical gusts of some 0.4 m/s over half a minute. The altimeter has a noise of 0.3 m,
# and one outlier of 40 m.

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
# Columns have units; everything that is dropped or derived is listed. The outlier is removed, the descent rate is the
# derivative of the altitude, and since the record has no air data, the density is that of the standard atmosphere. Only
# the first 75 s are fitted; the rest is held out.

# %%
raw = bc.read_record(file, {"time": ("time_s", "s"), "altitude": ("altitude_m", "m")})
flight = bc.Flight(raw, name="sonde", rate="1 Hz", identify_until="75 s")
for repair in flight.repairs:
    print(f"{repair.kind:10} {repair.variable:14} {repair.start:5.0f} to {repair.end:3.0f} s  {repair.detail}")

# %% [markdown]
# ## Priors and noise model
#
# The maker's drag area and mass give 0.13 m²/kg, within a factor of about 1.5. The measurement noise of the descent
# rate is white noise plus noise that is correlated over some seconds. The vertical velocity of the air is a latent
# Ornstein-Uhlenbeck process. Without it the interval would be far too narrow, since samples within one gust would be
# treated as independent. The values of the noise model are prior medians; they are estimated from the record.

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
# `fit` finds the mode of the marginal posterior (with the motion of the air and the initial speed integrated out) and
# the noise parameters. `sample` draws from that posterior, each draw with its own draw of the noise parameters, and
# checks fit and draws. The result contains an ArviZ tree; it can be saved, and used to predict other flights.

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
# `numpyro_model` is the density for fixed noise parameters as a numpyro model: one site per parameter, in its unit. All
# methods of numpyro can be applied to it; here its NUTS sampler is compared with the draws in the group `conditional`.

# %%
held = posterior.data["conditional"]["cds_over_mass"].values.ravel()
begin = init_to_value(values={"cds_over_mass": np.array(drag.mean())})
kernel = NUTS(bc.numpyro_model(fit), init_strategy=begin)
plain = MCMC(kernel, num_warmup=50, num_samples=200, progress_bar=False)
plain.run(jax.random.key(SEED))
theirs = np.asarray(plain.get_samples()["cds_over_mass"])
print(f"numpyro: {theirs.mean():.4f} +- {theirs.std():.4f} m^2/kg, ours: {held.mean():.4f} +- {held.std():.4f}")

# %% [markdown]
# ## Identifiability, and confounding of drag and gusts
#
# The data remove nearly all of the prior variance. But a slow gust has the same effect as another drag. How much of the
# posterior variance is due to the uncertain strength and time constant of the gusts? A short record hardly identifies
# them, so it is about a third.

# %%
contraction = 1.0 - (np.log(drag).std() / prior.scale) ** 2
facts = posterior.identifiability().loc["cds_over_mass"]
share, partner = facts["noise_share"], facts["noise_partner"]
print(f"taken away from the prior's variance: {contraction:.1%}")
print(f"due to unknown noise parameters: {share:.1%} of the variance; foremost {partner}")

# %% [markdown]
# ## Predictive bands of the held-out part
#
# Every draw of the drag has its own noise parameters and its own motion of the air: conditional on the data as far as
# there are data, and free after that. So the band widens where the data end. The held-out part contains one or two
# independent gusts, so the coverage of a single flight scatters widely about 90 %; calibration needs many flights.

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
# The requirement: no more than 11 m/s at the end. The probability is the share of draws that meet it; the interval is
# the Monte Carlo error of the number of draws.

# %%
risk = forecast.probability("descent_rate", statistic="final", at_most=LIMIT)
print(f"P(met) = {risk.met:.3f}, with {risk.confidence:.0%} confidence between {risk.low:.3f} and {risk.high:.3f}")

# %% [markdown]
# One flight carries no information on the air or the canopy of the next one. `models/studies/dropsondes.toml` fits
# several drops in a hierarchical model; `bc.Study.example()` does all of this for a capsule under two canopies.
