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
# # Modal identification: frequency and damping of a swing, with uncertainty
#
# A rocket descends under its parachute, and a logger on board records angular rates and accelerations at about 90 Hz.
# From these data alone we determine the part of the log in which the rocket hangs under the open canopy, and frequency
# and damping of its swing, with intervals.
#
# Run it on your own logs, as a script or with the environment variable `BAYESCHUTE_DATA`:
#
#     python notebooks/modal.py --data DIR        (DIR/ncsu_firm/*.csv.gz, or DIR/*.csv.gz)
#
# Without logs, it simulates one with known frequency and damping.

# %%
import argparse
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import make_record
from bayeschute.swing.fourier import harmonics
from bayeschute.swing.hanging_swing import hanging_swing
from bayeschute.swing.modal import amplitude_effect, compare_halves
from bayeschute.swing.second_order import second_order_output_error
from bayeschute.swing.spectrum import multitaper

parser = argparse.ArgumentParser()
parser.add_argument("--data", default=os.environ.get("BAYESCHUTE_DATA"))
given = parser.parse_known_args()[0].data
folder = None if given is None else Path(given)
logs = [] if folder is None else sorted([*folder.glob("ncsu_firm/*.csv.gz"), *folder.glob("*.csv.gz")])
if given is not None and not logs:
    raise SystemExit(f"{given}: no *.csv.gz there, nor in its folder ncsu_firm")

# %% [markdown]
# ## A log
#
# Columns have units. The simulated rocket tumbles for 15 s under a drogue, hangs for 22 s under its main canopy,
# spinning in one direction and then the other while gusts excite its swing, and then lies on the ground. Its logger is
# misaligned.

# %%
COLUMNS = {
    "time": ColumnSpec("t_s", "s"),
    "pressure": ColumnSpec("pressure_pascals", "Pa"),
    **{f"capsule_rate.{a}": ColumnSpec(f"raw_angular_rate_{a}_deg_per_s", "deg/s") for a in "xyz"},
    **{f"capsule_specific_force.{a}": ColumnSpec(f"raw_acceleration_{a}_gs", "g_0") for a in "xyz"},
}
TRUE_FREQUENCY, TRUE_DAMPING = 0.9, 0.025


def made_up(seed: int):
    """A log whose swing is known."""
    rng, dt = np.random.default_rng(seed), 0.011
    n = [round(s / dt) for s in (15.0, 22.0, 8.0)]
    omega = 2.0 * np.pi * TRUE_FREQUENCY
    tilt = np.zeros((n[1], 2))
    state = np.array([[0.10, 0.04], [0.0, 0.45]])  # angles and rates in two directions
    for i in range(n[1]):
        tilt[i] = state[0]
        kick = 0.06 * np.sqrt(dt) * rng.standard_normal(2)
        state[1] += -dt * (2.0 * TRUE_DAMPING * omega * state[1] + omega**2 * state[0]) + kick
        state[0] += dt * state[1]
    turn = np.cumsum(np.linspace(-5.0, 6.0, n[1])) * dt
    lean = Rotation.from_rotvec(np.column_stack([tilt, np.zeros(n[1])]))
    attitude = lean * Rotation.from_rotvec(turn[:, None] * [0.0, 0.0, 1.0])
    rate = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / dt
    mounted = Rotation.from_euler("xyz", [40.0, 100.0, -25.0], degrees=True)
    hanging = np.tile(mounted.apply([0.0, 0.0, 9.81]), (n[1], 1))
    tumble = np.cumsum(rng.standard_normal((n[0], 3)), axis=0) * 5.0 * np.sqrt(dt)
    rates = np.concatenate([tumble, mounted.apply(np.vstack([rate, rate[-1:]])), np.zeros((n[2], 3))])
    forces = np.concatenate([15.0 * rng.standard_normal((n[0], 3)), hanging, np.tile([0.0, 9.8, 0.0], (n[2], 1))])
    forces[n[0]], forces[n[0] + n[1]] = 8.0 * forces[n[0]], 12.0 * forces[n[0] + n[1]]  # opening, touchdown
    altitude = 600.0 - np.cumsum(np.repeat([25.0, 5.0, 0.0], n)) * dt
    noisy = [x + s * rng.standard_normal(x.shape) for x, s in ((rates, 0.003), (forces, 0.05), (altitude, 0.3))]
    names = ("capsule_rate", "capsule_specific_force", "altitude")
    return make_record(time=np.arange(sum(n)) * dt, **dict(zip(names, noisy, strict=True)))


records = {path.name: read_record(path, COLUMNS) for path in logs} or {"made up": made_up(3)}

# %% [markdown]
# ## Frequency and damping
#
# `hanging_swing` does three things. It detects the descent: back from touchdown as long as the descent rate equals that
# at the end, between the opening shock and the impact. It removes the spin: gyro rates are integrated to an attitude in
# non-rotating axes, in which the mean acceleration gives the vertical, and the swing is the motion of the hanging axis
# relative to it. And it fits a damped oscillator with random forcing by gusts, in colored noise, in both directions at
# once. A beginning that is still disturbed by the opening is excluded.

# %%
found = {}
for name, record in records.items():
    swing = found[name] = hanging_swing(record)
    fit, window = swing.fit, swing.window
    print(f"{name}: descent at {window.descent_rate:.1f} m/s from {window.start:.1f} to {window.end:.1f} s")
    print(f"  fitted from {window.start + fit.start:.1f} s: {fit.cycles:.1f} cycles, {fit.ess:.0f} effective draws")
    for label, quantity, unit in (
        ("frequency", fit.frequency, "Hz"),
        ("period", fit.period, "s"),
        ("damping ratio", fit.damping_ratio, ""),
    ):
        print(f"  {label:14} {quantity.mean:7.4f} {unit:2}, 90 % between {quantity.low:.4f} and {quantity.high:.4f}")
    degrees = np.rad2deg([fit.amplitude.mean, fit.amplitude.low, fit.amplitude.high])
    print("  amplitude      {:7.2f} deg at the start, 90 % between {:.2f} and {:.2f}".format(*degrees))

# %%
figure, axes = plt.subplots(len(found), 2, figsize=(11.0, 3.2 * len(found)), squeeze=False, layout="constrained")
for (name, swing), (left, right) in zip(found.items(), axes, strict=True):
    left.plot(swing.time, np.rad2deg(swing.motion.rate), lw=0.9)
    left.axvspan(swing.time[0], swing.window.start + swing.fit.start, color="0.9")
    left.set(xlabel="time [s]", ylabel="rate of the hanging axis [deg/s]", title=name)
    here = np.isfinite(swing.motion.rate).all(axis=1) & (swing.time >= swing.window.start + swing.fit.start)
    step = float(np.median(np.diff(swing.time)))
    for component in swing.motion.rate[here].T:
        spectrum = multitaper(np.rad2deg(component), step)
        near = spectrum.frequency < 3.0
        right.fill_between(spectrum.frequency[near], spectrum.low[near], spectrum.high[near], alpha=0.3, lw=0)
        right.semilogy(spectrum.frequency[near], spectrum.power[near])
    right.axvspan(swing.fit.frequency.low, swing.fit.frequency.high, color="0.6", alpha=0.6)
    right.set(xlabel="frequency [Hz]", ylabel="(deg/s)$^2$/Hz", title="spectrum; grey: the fit's 90 % interval")
plt.show()

# %% [markdown]
# ## Without the random forcing
#
# A damped sinusoid in colored noise, without forcing, fits the same records with far narrower intervals. Over
# replicates with gusts these intervals contain the truth only a quarter of the time (`benchmarks/modal_coverage.py`).

# %%
free = {}
for name, swing in found.items():
    same = (swing.window.start + swing.fit.start, swing.window.end)
    free[name] = hanging_swing(records[name], same, forcing=False, settle=False).fit
    for label, fit in (("with gusts", swing.fit), ("as if free", free[name])):
        f, z = fit.frequency, fit.damping_ratio
        print(f"{name}, {label}: {f.mean:.4f} +- {f.sd:.4f} Hz, damping ratio {z.mean:.4f} +- {z.sd:.4f}")

# %% [markdown]
# ## Change during the descent
#
# The frequency of a gravity pendulum is lower by 1/16 of the square of its amplitude. Apart from that, the two halves
# of a record should agree. Where they don't, something else changed: spin in resonance with the swing, lines that
# untwist, or the wind.

# %%
for name, swing in found.items():
    relative, _ = amplitude_effect(swing.fit.amplitude.mean)
    halves = compare_halves(swing.fit)
    change = halves.frequency_change
    print(f"{name}: the amplitude at the start lowers the frequency by {-100.0 * relative:.2f} %")
    print(f"  second half minus first: {change.mean:+.4f} Hz, 90 % between {change.low:+.4f} and {change.high:+.4f}")
    spin = np.abs(swing.motion.spin) / (2.0 * np.pi)
    middle = spin.size // 2
    print(f"  mean spin of the halves: {spin[:middle].mean():.2f} and {spin[middle:].mean():.2f} turns per second")

# %% [markdown]
# ## The same in the frequency domain
#
# The report recommends frequency-domain methods (its R-8). Transforms of a band about the swing, end effects included,
# give by output error the same frequency without a model of the rest of the spectrum. Its standard errors assume a flat
# noise spectrum in the band and a free swing, so they are too small.

# %%
domain = {}
for name, swing in found.items():
    p = swing.fit.problem
    channel = int(np.argmax(np.nanstd(p.data, axis=0)))
    y, where = p.data[:, channel], np.arange(len(p.data))
    y = np.interp(where, where[np.isfinite(y)], y[np.isfinite(y)])
    band = harmonics((y.size - 1) * p.dt, 0.7 * swing.fit.frequency.mean, 1.3 * swing.fit.frequency.mean)
    made = second_order_output_error(y, p.dt, band, seen=("rate",))
    omega = np.sqrt(made.value("stiffness"))
    domain[name] = omega / (2.0 * np.pi)
    error = 0.5 * made.error("stiffness") / omega / (2.0 * np.pi)
    ratio = made.value("two_b") / (2.0 * omega)
    print(f"{name}: {domain[name]:.4f} +- {error:.4f} Hz, damping ratio {ratio:.4f} (converged: {made.converged})")

# %% [markdown]
# Clusters have more modes. `bayeschute.reduced.cluster_modes` labels the windows of a cluster's record (pendulum,
# glide, flyout, maypole) and estimates the coefficients that each mode identifies, with intervals.
