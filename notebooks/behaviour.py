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
# # Why a capsule swings under its parachutes
#
# Two coincident canopies and the capsule below them form a dumbbell: two particles on a rigid line, falling in a plane.
# This is the model of sections 6.3.1 and 7.1 of NASA/TM-2019-220410. With the five coefficients that the report
# identified from drop test CDT 3-11 it reproduces the pendulum motion of that drop. This notebook studies when the
# pendulum motion occurs, and which design changes reduce it.

# %%
# %matplotlib inline
from dataclasses import replace

import numpy as np

from bayeschute.aero.published import load_published
from bayeschute.core.units import to_si
from bayeschute.reduced import behaviour, cluster_mode_laws, pendulum
from bayeschute.reduced.motion import dumbbell
from bayeschute.reduced.published_models import planar_aero
from bayeschute.report.figures import behaviour_figures as draw
from bayeschute.verification.sets import T71

FEET = 1.0 / to_si("1 ft", "m")
table = load_published("table-7.1-2")
aero, model, density = planar_aero(table), dumbbell(T71), T71.density
print(table.source)
for parameter in table.parameters:
    print(f"{parameter.name:12} {parameter.estimate:8.4f} +- {parameter.standard_error:.4f} {parameter.unit}")

# %% [markdown]
# ## Static stability: the normal force curves
#
# A canopy of low porosity is statically unstable at zero angle of attack and trims at $\pm\alpha_0$: it glides. The
# report also shows a porous canopy, but gives no formula for it; here the same curve is used from the trim angle
# outward, with the lower drag of a porous canopy.

# %%
porous = replace(aero, statically_stable=True)
draw.curves_figure(aero, porous)

# %% [markdown]
# ## Dynamic stability: the limit cycle
#
# At $C_{N\dot\alpha}$ = -0.988 s the damping is negative: the airflow feeds energy into the swing. After a small
# disturbance of the descent the canopies move to one trim angle, cross over to the other one, and end in a limit cycle.

# %%
motion = behaviour.disturbed_descent(model, aero, density)
cycle = behaviour.limit_cycle(model, aero, density)
print(f"limit cycle: {cycle.amplitude:.3f} rad ({np.rad2deg(cycle.amplitude):.1f} deg) at {cycle.frequency:.4f} Hz,")
print(f"mean descent {cycle.descent_rate:.2f} m/s ({cycle.descent_rate * FEET:.1f} ft/s)")
draw.motion_figure(motion, float(aero.trim()))

# %% [markdown]
# If the sign of the damping is changed after 50 s, the swing decays and the canopies glide.

# %%
flipped = behaviour.damping_flip(model, aero, density, at=50.0)
draw.motion_figure(flipped, float(aero.trim()), flipped_at=50.0)

# %% [markdown]
# ## Four designs
#
# Static and dynamic stability are independent properties. All four designs start from the same swing.

# %%
configurations = behaviour.four_configurations(model, aero, density)
for one in configurations:
    kinds = [("unstable", "stable")[stable] for stable in (one.statically_stable, one.dynamically_stable)]
    print(f"statically {kinds[0]:8} dynamically {kinds[1]:8} ends in a {one.ending}")
draw.configuration_figure(configurations)

# %% [markdown]
# ## Bistability: the outcome depends on the disturbance
#
# Close to zero damping there are two attractors: after a small disturbance the motion returns to the glide, after a
# large one it ends in the limit cycle. The linear threshold $-C_{N\alpha} L_C/V$ gives only the limit below which no
# glide is stable.

# %%
grid = np.array([-0.3, -0.26, -0.22, -0.19, -0.17, -0.15, -0.12, -0.09, -0.06, -0.04, -0.02, -0.01, 0.0, 0.02, 0.05])
ends = behaviour.bistability(model, aero, density, grid, duration=900.0)
both = ends.damping[ends.bistable()]
print(f"both ends possible from {both.min():.2f} to {both.max():.2f} s; linear threshold {ends.threshold:.3f} s")
draw.bistability_figure(ends)

# %% [markdown]
# ## Onset of the pendulum motion by wind shear
#
# With the damping of the table any disturbance starts the pendulum, and a wind shear only determines when. In the
# bistable range it determines whether. A steady glide descends through a layer in which the wind changes; thin layers
# and large changes start the pendulum, and the change needed depends on its direction relative to the glide.

# %%
change, thickness = np.arange(-20.0, 20.1, 2.5), np.array([10.0, 30.0, 100.0, 300.0])
onset = behaviour.shear_onset(model, replace(aero, C_Nalphadot=-0.1), density, change, thickness)
draw.onset_figure(onset, shown=[(5, 1), (4, 1)])

# %% [markdown]
# ## The pivot point
#
# One point of the line hardly moves laterally. The closer it is to the capsule, the less the capsule swings. A heavier
# payload, lower air density and less drag bring it closer (F-1, F-3, F-4 of the report), but increase the rate of
# descent. They also increase the growth rate of the *linear* pendulum, since the same damping coefficient acts with
# more force; the amplitude of the limit cycle is smaller nevertheless.

# %%
linear = pendulum.pendulum(model, density, aero.C_A0)
omega = pendulum.natural_frequency(linear, aero.C_Nalpha)
print(f"capsule to pivot point {pendulum.pivot_distance(linear, aero.C_Nalpha):.1f} m of {model.length:.1f} m")
print(f"linear pendulum {omega / (2 * np.pi):.4f} Hz, limit cycle {cycle.frequency:.4f} Hz")
sensitivity = behaviour.pivot_sensitivity(model, aero, density, np.linspace(0.7, 1.3, 7))
for name, elasticity in zip(behaviour.QUANTITIES, sensitivity.elasticity, strict=True):
    print(f"1 % more {name:12} moves the pivot point by {elasticity:+.2f} %")
draw.pivot_figure(sensitivity)

# %% [markdown]
# ## Coefficients from other modes (inverse formulas)
#
# Observed modes of a drop give coefficients: flyout with a period of 15 s, maypole with a period of 35 s and a radius
# of 50 ft, breathing at 0.23 Hz with a descent rate between 32 and 35.2 ft/s.

# %%
canopy = cluster_mode_laws.Canopy(T71.canopy_mass, T71.dry_weight, T71.length)
slope = cluster_mode_laws.flyout_slope(canopy, T71.load, 15.0)
turning, radius = 2 * np.pi / 35.0, to_si("50 ft", "m")
load = cluster_mode_laws.maypole_q_area(canopy, T71.C_A, radius, turning, T71.weight)
breathing = cluster_mode_laws.Breathing(T71.mass, T71.weight, to_si("34 ft/s", "m/s"), T71.C_A)
C_Aeta = cluster_mode_laws.breathing_axial_slope(breathing, to_si("1.6 ft/s", "m/s"), 0.23)
print(f"flyout:    C_Nalpha = {slope:.2f} per rad")
print(f"maypole:   C_N = {cluster_mode_laws.maypole_normal(canopy, load, radius, turning):.4f}")
print(f"breathing: C_Aeta = {C_Aeta:.3f} for eta = 1")
