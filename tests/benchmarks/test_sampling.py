"""The counting of benchmarks/sampling.py, and its peers on a normal law whose density is known and costs nothing."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

P = 3


@pytest.fixture(scope="module")
def both():
    """The benchmark and its peers; importing them sets the number of threads of processes yet to come."""
    import sampling
    import sampling_peers

    return SimpleNamespace(main=sampling, peers=sampling_peers)


@pytest.fixture
def target(both):
    """Standard normal; in prior standard deviations it is narrow, correlated and off the middle."""
    matrix = np.array([[0.3, 0.0, 0.0], [0.2, 0.1, 0.0], [0.0, -0.1, 0.05]])
    return both.peers.Target(
        P,
        lambda xi: -0.5 * np.sum(xi**2, axis=0),
        lambda xi: np.concatenate([xi[:, 0], [0.0, 0.0]]),
        lambda numbers, xi: -0.5 * jnp.sum(xi**2) * numbers,
        jnp.ones(()),
        (matrix, np.array([0.5, -1.0, 0.0])),
    )


class Steps:
    """A clock that moves on by one whenever it is read: budgets are then counts, and draws don't depend on the load."""

    def __init__(self):
        self.at = 0.0

    def __call__(self):
        self.at += 1.0
        return self.at


BUDGETS = {"numpyro_nuts_plain": 400.0, "numpyro_nuts_whitened": 400.0, "blackjax": 400.0, "aeroid": 30000.0}
PACKAGES = {"pints": "pints", "aeroid": "aeroid", "blackjax": "blackjax"}
NAMES = (
    "emcee, stretch", "emcee, DE", "PINTS, Haario-Bardenet", "PINTS, DREAM", "aeroid, stretch",
    "numpyro NUTS, whitened", "blackjax NUTS, whitened", "numpyro NUTS, plain",
)  # fmt: skip


def test_all_peers_are_tested(both):
    assert tuple(both.peers.PEERS) == NAMES


@pytest.mark.filterwarnings("ignore:chain may not have converged:UserWarning")
@pytest.mark.parametrize("name", NAMES)
def test_peers_draw_from_the_density(both, target, name):
    key, peer = both.peers.PEERS[name]
    if key in PACKAGES:
        pytest.importorskip(PACKAGES[key])
    clock = both.peers.Clock(Steps(), BUDGETS.get(key, 500.0))
    xi = peer(target, clock, 1)
    assert xi.ndim == 3 and xi.shape[2] == P and xi.shape[1] > 50 and clock.compiled > 0.0
    ess, _, kept = both.main.kindest(xi)
    assert ess > 100.0
    flat = kept.reshape(-1, P)
    assert np.abs(flat.mean(axis=0)).max() < 5.0 / np.sqrt(ess)
    assert np.abs(flat.std(axis=0) - 1.0).max() < 5.0 / np.sqrt(ess)


def test_compilation_is_not_charged_to_the_budget(both):
    clock = both.peers.Clock(Steps(), 10.0)
    with clock.compiling():
        for _ in range(50):
            clock.now()
    assert clock.compiled == 51.0 and clock.total == 53.0
    assert clock.left() == pytest.approx(10.0 - (54.0 - 51.0))


def test_effective_draws_of_independent_and_of_few(both):
    rng = np.random.default_rng(0)
    ess, rhat = both.main.effective(rng.standard_normal((4, 1000, P)))
    assert 3000.0 < ess <= 4000.0 and rhat < 1.01
    few, unknown = both.main.effective(rng.standard_normal((4, 3, P)))
    assert few == 12.0 and np.isnan(unknown)
    assert both.main.effective(np.zeros((4, 0, P)))[0] == 1.0
    stuck = rng.standard_normal((4, 1, P)) + 0.01 * rng.standard_normal((4, 1000, P))
    assert both.main.effective(stuck)[0] < 20.0


def test_a_bad_opening_is_left_out(both):
    xi = np.random.default_rng(1).standard_normal((4, 400, P))
    xi[:, :90] += 30.0
    ess, rhat, kept = both.main.kindest(xi)
    assert kept.shape[1] == 300 and ess > 900.0 and rhat < 1.02
    assert both.main.off(xi, kept) > 1.0 > both.main.off(kept, kept) == 0.0


def test_speedups_are_of_effective_draws_per_second_and_the_fastest_of_a_name_counts(both):
    mine = both.main.Row(1000.0, 2000, 1.0, 50.0, 20.0, 10.0, 0.0)
    slow = both.main.Row(10.0, 99, 1.2, 100.0, 60.0, 50.0, 0.1)
    rows = {"a": ("pints", slow), "b": ("pints", slow._replace(ess=100.0)), "c": ("emcee_de", slow)}
    assert both.main.speedups(mine, rows, "seconds") == {"speedup_vs_pints": 20.0, "speedup_vs_emcee_de": 200.0}
    assert both.main.speedups(mine, rows, "sampling")["speedup_vs_pints"] == pytest.approx(50.0)
    assert "not converged" in slow.remark and mine.remark == "" and "too few" in slow._replace(rhat=np.nan).remark
    assert both.main.plain(slow._replace(off=np.nan))["off"] is None


def test_from_end_to_end_with_one_peer_absent(both, target, monkeypatch, capsys):
    """Ours is put in; the rest runs as it is, but for the process-wide settings."""
    draws = np.random.default_rng(2).standard_normal((4, 500, P))
    mine = both.main.Row(2000.0, 2000, 1.0, 60.0, 30.0, 5.0, 0.0)
    fewer = mine._replace(ess=500.0)

    def absent(target, clock, seed):
        raise ModuleNotFoundError("No module named 'nowhere'", name="nowhere")

    kept = {"emcee, stretch": both.peers.PEERS["emcee, stretch"], "elsewhere": ("elsewhere", absent)}
    monkeypatch.setattr(both.peers, "PEERS", kept)
    monkeypatch.setitem(sys.modules, "sampling_peers", both.peers)
    monkeypatch.setattr(both.main, "ours", lambda *_: (None, draws, [mine, fewer], (55.0, 25.0)))
    monkeypatch.setattr(both.main, "target_of", lambda marginal: target)
    monkeypatch.setattr("jax.clear_caches", lambda: None)
    monkeypatch.setattr("jax.config.update", lambda *_: None)
    given = SimpleNamespace(budget=500.0, peers=None, seed=1, quick=False, wall=False, json=True)
    both.main.measure(given, Steps(), Path("nowhere"))
    *lines, last = capsys.readouterr().out.splitlines()
    assert any("nowhere is not installed" in line for line in lines)
    made = json.loads(last)
    row = made["context"]["peers"]["emcee, stretch"]
    assert row["seconds"] - 55.0 > row["without"] - 25.0 == row["sampling"] > 490.0
    wanted = (2000.0 / 60.0) / (row["ess"] / row["seconds"])
    assert made["ratios"] == {"speedup_vs_emcee_stretch": pytest.approx(wanted)}
    asked = made["context"]["speedups_with_the_draws_of_a_study"]
    assert asked == {"speedup_vs_emcee_stretch": pytest.approx(wanted / 4.0)}
    assert made["context"]["absent"] == ["elsewhere"] and made["context"]["densities_differ_by"] is None
