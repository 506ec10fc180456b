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
# # Choosing a structure: what equation error can and can't tell
#
# Which aerodynamic terms does a record support? Equation error answers in seconds: forces from accelerations, candidate
# terms as regressors, the predicted squared error as judge. This notebook asks how sure the answer is, by two kinds of
# replicates: bootstrap replicates of one record, and records of the same canopies in other air.

# %%
# %matplotlib inline
import os
from collections import Counter
from dataclasses import replace

import numpy as np

import bayeschute as bc

DROPS = 3 if os.environ.get("BAYESCHUTE_SMALL") else 20
study = bc.Study.example()
truth = study.vehicle.aero
print("axial:     ", truth.axial)
print("transverse:", truth.transverse)

# %% [markdown]
# ## One record
#
# The record is reconstructed: riser tensions from the capsule's accelerometer, forces of the canopies from their
# motion. The last column of the table is the share of bootstrap replicates of this record that select the term.

# %%
motion = bc.reconstruct(study.flights["cdt-3-11"])
structure = bc.select_structure(motion, study.candidates)
structure.plot()

# %%
structure.table

# %% [markdown]
# ## The same canopies in other air
#
# The study is simulated again with other seeds: other gusts, other sensor errors, the same terms. The wind that is
# recorded is not the wind at the canopies, and its error enters forces and regressors alike.

# %%
chosen, estimates = Counter(), []
for seed in range(1, DROPS + 1):
    again = bc.Study(replace(study.spec, seed=seed))
    table = bc.select_structure(again.flights["cdt-3-11"]).table
    chosen.update(f"{row.coefficient}[{row.term}]" for row in table.itertuples())
    for row in table.itertuples():
        true = getattr(truth, row.coefficient).get(row.term, 0.0)
        estimates.append((f"{row.coefficient}[{row.term}]", (row.estimate - true) / row.se))

# %%
true_terms = {f"axial[{t}]" for t in truth.axial} | {f"transverse[{t}]" for t in truth.transverse}
for name, count in chosen.most_common():
    print(f"{name:30} {count / DROPS:4.0%}  {'true' if name in true_terms else 'not there'}")

# %% [markdown]
# ## How far off are the estimates?
#
# An estimate should be within 1.6 of its standard errors nine times in ten.

# %%
size = np.abs([z for _, z in estimates])
within = float(np.mean(size < 1.645))
stand_ins = sum(count for name, count in chosen.items() if name not in true_terms)
missed = sum(DROPS - chosen[name] for name in true_terms)
print(f"{within:.0%} of {size.size} estimates within 1.6 standard errors; the largest is {size.max():.0f} off")

# %% [markdown]
# ## The finding
#
# Over the records, terms that are not there are selected in the place of terms that are, and the bootstrap of one
# record doesn't show it: it redraws the residuals, not the wind. So a structure from equation error is a proposal. The
# study says `fit = "search"`: all candidates are fitted to the flight itself, with the error of the wind as a latent
# process, and the evidence decides there; and equation error's covariance enters priors with an inflation of ten.

# %%
print(f"{stand_ins / DROPS:.1f} terms per record that are not there, {missed / DROPS:.1f} true ones missed")
