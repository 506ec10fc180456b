"""emcee's affine-invariant ensemble (Foreman-Mackey et al. 2013) in standard coordinates, batched.

Several independent ensembles serve as chains: walkers of one ensemble are not independent, so R-hat over them is
meaningless. Each ensemble is thinned by its own autocorrelation time before its walkers are concatenated.
"""

from __future__ import annotations

import emcee
import numpy as np

from bayeschute.core.random import stream
from bayeschute.posterior.sampling.protocol import Counted, Draws, LogDensity, Progress

_WIDE = 1.2  # standard deviation of walkers at their start
_NEARER = 10  # times that walkers which don't fly at their start are put halfway to the origin


def _begun(log_density: Counted, walkers: int, parameters: int, rng: np.random.Generator) -> emcee.State:
    """Walkers about the origin, nearer to it where the density has nothing for them."""
    x = _WIDE * rng.standard_normal((walkers, parameters))
    value = log_density(x.T)
    for _ in range(_NEARER):
        lost = ~np.isfinite(value)
        if not lost.any():
            break
        x[lost] *= 0.5
        value[lost] = log_density(x[lost].T)
    return emcee.State(x, log_prob=value)


def sample(
    log_density: LogDensity,
    parameters: int,
    chains: int,
    draws: int,
    seed: int,
    walkers: int = 0,
    most_steps: int = 20000,
    progress: Progress | None = None,
) -> Draws:
    """Draw with emcee's differential evolution moves.

    Not with its snooker moves: those of emcee 3.1 take the distances' ratio to half the power that detailed balance
    asks for (ter Braak and Vrugt 2008, step 3), and make variances too small (`tests/laws/test_samplers.py`).

    Args:
        log_density: Log densities (B,) of points (P, B).
        parameters: P.
        chains: Independent ensembles.
        draws: Nearly independent draws wanted per ensemble.
        seed: Seed.
        walkers: Walkers per ensemble; 4 P, an even number, where 0.
        most_steps: Maximum number of steps of an ensemble.
        progress: Called with draws done and wanted.

    Returns:
        The draws; a note says so where an ensemble ended early.
    """
    walkers = walkers or 2 * (2 * parameters)
    counted = Counted(log_density)
    xi, lp, acceptance, notes = [], [], [], []
    for chain in range(chains):
        rng = stream(seed, "ensemble sampler", chain)
        moves = emcee.moves.DEMove()
        sampler = emcee.EnsembleSampler(
            walkers, parameters, lambda x: counted(np.asarray(x).T), moves=moves, vectorize=True
        )
        np_state = np.random.RandomState(rng.integers(2**31))
        sampler._random = np_state  # emcee takes a state only together with a position
        state = _begun(counted, walkers, parameters, rng)
        block, tau = 200, np.inf
        while sampler.iteration < most_steps:
            state = sampler.run_mcmc(state, block, skip_initial_state_check=True)
            tau = float(np.max(sampler.get_autocorr_time(tol=0)))
            kept = (sampler.iteration - 5.0 * tau) * walkers / tau
            if progress is not None:
                progress(int(draws * (chain + min(max(kept / draws, 0.0), 1.0))), draws * chains)
            if kept > draws and sampler.iteration > 20.0 * tau:
                break
        else:
            notes.append(f"ensemble {chain + 1} ended after {most_steps} steps with autocorrelation time {tau:.0f}")
        tau = tau if np.isfinite(tau) else float(sampler.iteration)  # not finite where no walker ever moved
        burn = min(int(5 * tau), sampler.iteration // 2)
        thin = min(max(int(np.ceil(tau)), 1), sampler.iteration - burn)
        x = sampler.get_chain(discard=burn, thin=thin, flat=True)
        value = sampler.get_log_prob(discard=burn, thin=thin, flat=True)
        pick = np.sort(rng.permutation(len(x))[: min(draws, len(x))])
        xi.append(x[pick])
        lp.append(value[pick])
        acceptance.append(float(np.mean(sampler.acceptance_fraction)))
    least = min(len(x) for x in xi)
    rates = np.repeat(np.array(acceptance)[:, None], least, axis=1)
    return Draws(
        np.stack([x[:least] for x in xi]),
        np.stack([v[:least] for v in lp]),
        {"acceptance_rate": rates},
        counted.failed,
        counted.evaluations,
        tuple(notes),
    )
