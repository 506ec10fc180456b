"""The descents of benchmarks/gpu.py against the simulator's own flights, on the processor."""

from __future__ import annotations

import sys

import gpu
import numpy as np
import pytest

from bayeschute.compiler import compiled_model as kernel
from bayeschute.dynamics.cluster_flight import quantity

T, BATCH = 61, 4


def test_descents_are_those_of_the_simulator():
    pytest.importorskip("llvmlite")
    some = gpu.flights(gpu.PLAIN, T, 1)
    model = some.model
    theta, start, knots = gpu.drivers(model, some.theta[:, 0], BATCH)
    last, widest = gpu.land(model, theta, start, knots)
    series = knots.reshape(len(knots), -1)
    at = np.arange(len(knots)) * gpu.EVERY
    error = np.stack([np.interp(np.arange(T), at, column) for column in series.T], axis=1).reshape(T, *knots.shape[1:])
    x = kernel.states(model, theta, start, error)
    assert np.abs(np.asarray(last) - np.asarray(x)[-1]).max() < 1e-8
    swing = [quantity("swing_angle", s, 1.0, model.base.capsule.attach_b, 2) for s in x]
    np.testing.assert_allclose(widest, np.max(swing, axis=0), rtol=1e-9)


def test_first_flights_do_not_depend_on_the_batch():
    some = gpu.flights(gpu.PLAIN, T, 1)
    few, many = (gpu.drivers(some.model, some.theta[:, 0], count) for count in (3, 7))
    for a, b in zip(few, many, strict=True):
        np.testing.assert_array_equal(a, b[..., :3])


def test_without_gpu_it_says_that_it_was_not_run(monkeypatch, capsys):
    monkeypatch.setattr(gpu, "device_of", lambda here: None)
    monkeypatch.setattr(sys, "argv", ["gpu.py", "--json"])
    gpu.main()
    told, line = capsys.readouterr().out.splitlines()
    assert told.startswith("not run") and '"ratios": {}' in line
