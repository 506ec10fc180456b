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
# # Reading a posterior: what is identified, what is prior
#
# A posterior always has intervals. Some of them are the record's, some are the prior's. This notebook reads one:
# parameter by parameter, then as curves over the angle of attack, then beyond the angles that were flown.

# %%
# %matplotlib inline
import os

import numpy as np

import bayeschute as bc

study = bc.Study.example()
flight, candidates, draws = study.flights["cdt-3-11"], study.candidates, 2000
if os.environ.get("BAYESCHUTE_SMALL"):  # for a test of this notebook, not for use
    flight, draws = flight.changed(window=(0.0, 25.0)), 400
    few = {"axial": ("1", "alpha^2"), "transverse": ("e", "e*alpha^2", "rate"), "fit": "pool"}
    candidates = candidates.model_copy(update=few)
structure = bc.select_structure(flight, candidates)
priors = bc.Priors.from_structure(structure) | study.priors
posterior = bc.sample(bc.fit([flight], priors, noise=study.noise), draws=draws, seed=1)
posterior

# %% [markdown]
# ## Did it work?
#
# Before reading anything: the checks of the draws, of the mode, and of the density itself.

# %%
posterior.checks()[["passed", "value", "bound"]]

# %% [markdown]
# ## Parameter by parameter
#
# Contraction is the share of the prior's variance that the record took away. `noise_share` is what comes from not
# knowing how strong gusts and sensor noise are, and the diagnosis says whether prior and likelihood disagree.

# %%
told = posterior.identifiability()
told[["contraction", "noise_share", "diagnosis"]].sort_values("contraction", ascending=False)

# %% [markdown]
# Stiffness and damping of the risers hardly contract: a record at 10 Hz does not see how a riser stretches and damps.
# Their intervals are those of `[priors.given]`, and must be quoted as such.
#
# ## Coefficients are correlated, curves are known
#
# The coefficients of $C_N(\alpha)$ = `e` and `e*alpha^2` are strongly correlated: each alone is uncertain, their sum
# over the angles that were flown is not.

# %%
one, other = (posterior[n].values.ravel() for n in ("transverse[e]", "transverse[e*alpha^2]"))
correlation = float(np.corrcoef(one, other)[0, 1])
low, high = posterior.ranges["alpha"]
print(f"correlation {correlation:.2f}; flown: {np.rad2deg(low):.0f} to {np.rad2deg(high):.0f} deg")
curve = posterior.curve("C_N", over=(0.0, 0.7))
curve.plot().figure

# %% [markdown]
# ## Beyond what was flown
#
# Dotted, the curve is the form of the terms, carried on. The band there is too narrow by as much as the form is wrong,
# which the record can't say. Compare the width of the band where it was flown with that of the prior.

# %%
table = curve.to_frame()
width = table["high"] - table["low"]
width_of_prior = table["prior_high"] - table["prior_low"]
flown = table["flown"]
narrowing = float((width / width_of_prior)[flown].median())
outside = float(width[~flown].iloc[-1] / width[flown].median())

# %% [markdown]
# ## The finding
#
# What to write down: the curve over the angles flown, with its band; the coefficients only together with their
# correlation; and riser properties as prior values.

# %%
least = told["contraction"].astype(float).idxmin()
print(f"Within the angles flown the band of C_N is {narrowing:.0%} as wide as the prior's.")
print(f"At 40 deg, which nobody flew, it is {outside:.1f} times as wide, and its form is an assumption.")
print(f"Least informed: {least}, contraction {told.loc[least, 'contraction']:.2f}: quote it as a prior.")
