"""Sampling of the marginal posterior, with other samplers to fall back on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.random import stream
from bayeschute.posterior.felt_axes import groups
from bayeschute.posterior.marginal import (
    BATCH,
    Marginal,
    flight_residuals,
    in_batches,
    in_range,
    log_density,
    prior_lines,
)
from bayeschute.posterior.sampling import delayed_acceptance, ensemble, independence
from bayeschute.posterior.sampling.protocol import Draws
from bayeschute.posterior.sampling.sampler_checks import slowness, why_not_trusted
from bayeschute.posterior.surrogate import Surrogate, build

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
_TEMPERATURES = (1.1, 1.3)  # of the surrogate that proposes, tried in turn
EMCEE_DREW, INDEPENDENCE_DREW = "emcee drew instead", "an independence sampler drew instead"
"""Last words of the note on draws that are not those of the sampler asked for."""
_LONGER, _LONGEST = 2, 16  # longer walks that are tried where one mixes slowly, and how many times as long at most
_SPARE = 1.3  # of the length at which chains would just agree
_HOPELESS = 2.0  # times the longest walk: where one would have to be longer still, none is made
_LAST_STEPS = 1000  # of emcee's ensembles where all else failed: hours would not make such draws good


def sample(
    marginal: Marginal, kind: str, chains: int, warmup: int, draws: int, seed: int, progress: Progress | None = None
) -> Draws:
    """Draw parameters from the marginal posterior in standard coordinates.

    Args:
        marginal: The posterior.
        kind: ``"nuts"`` (numpyro's NUTS on a quadratic surrogate, corrected exactly by delayed acceptance) or
            ``"emcee"`` (ensembles on the same density). Where NUTS' walk mixes slowly longer ones are made, unless none
            would be long enough. Where its draws fail their own check (`why_not_trusted`), an independence sampler
            (`posterior.sampling.independence`) draws, and where its draws fail it too, emcee; a note says why.
        chains: Chains.
        warmup: Warm-up steps.
        draws: Draws per chain.
        seed: Seed.
        progress: Called with a share done and words.

    Returns:
        The draws.
    """
    asked = _Asked(marginal, chains, warmup, draws, seed, progress)
    if kind == "emcee":
        return asked.by_emcee()
    surrogate, notes = asked.surrogate()
    tried, reasons = list[Draws](), list[str]()
    for temperature in _TEMPERATURES:
        tried += asked.by_walks(replace(surrogate, temperature=temperature), kind)
        reasons.append(why_not_trusted(tried[-1]))
        if not reasons[-1]:
            return _last_of(tried, notes)
    words = f"Draws by NUTS on a surrogate failed their check ({reasons[0]}; on a flatter one {reasons[1]}); "
    other, why = asked.by_independence()
    if other is not None:
        tried.append(other)
    if other is None or why:
        words += f"so did those of an independence sampler ({why}); {EMCEE_DREW}"
        tried.append(asked.by_emcee(_LAST_STEPS))
    else:
        words += INDEPENDENCE_DREW
    return _last_of(tried, [*notes, words])


def _last_of(tried: Sequence[Draws], notes: Sequence[str]) -> Draws:
    """The last draws with what all samplers together have spent, and notes."""
    failed, evaluations = sum(one.failed for one in tried), sum(one.evaluations for one in tried)
    return replace(tried[-1], failed=failed, evaluations=evaluations, notes=(*tried[-1].notes, *notes))


@dataclass(frozen=True)
class _Asked:
    """A posterior, and what is to be drawn of it: see `sample`."""

    marginal: Marginal
    chains: int
    warmup: int
    draws: int
    seed: int
    progress: Progress | None

    @property
    def parameters(self) -> int:
        """How many."""
        return int(np.size(self.marginal.centre))

    def exact(self, xi: Array) -> Array:
        """Log density (B,) at standard coordinates (P, B)."""
        if xi.shape[1] in (16, BATCH // 2, BATCH):
            return np.asarray(log_density(self.marginal, xi))
        return np.asarray(in_batches(lambda part: log_density(self.marginal, part), xi))

    def residuals(self, number: int, xi: Array) -> Array:
        """Of a flight's linear model, for the surrogate; NaN where it tells nothing."""
        rows, price = flight_residuals(self.marginal, number, xi)
        return np.where(in_range(price[None]), rows, np.nan)

    def tell(self, name: str) -> Callable[[int, int], None]:
        """Progress of a sampler."""
        say = self.progress or (lambda share, words: None)
        return lambda done, wanted: say(done / wanted, f"{name}: {done} of {wanted}")

    def surrogate(self) -> tuple[Surrogate, list[str]]:
        """That on which NUTS walks, and what is to be said of it."""
        rng = stream(self.seed, "points of the surrogate")

        def residuals(number: int, xi: Array) -> Array:
            return np.asarray(in_batches(partial(self.residuals, number), xi))

        marginal = self.marginal
        made, failed = build(residuals, groups(marginal), prior_lines(marginal), marginal.correction, rng)
        lost = sum(int(along.lost) for along in self.marginal.along)
        notes = [
            f"{failed} of the places where the surrogate was fitted failed, or lie out of the linear models' range",
            f"{lost} pairs of simulations under drawn disturbances are not in the mean correction where they failed",
        ]
        return made, [words for count, words in zip((failed, lost), notes, strict=True) if count]

    def by_walks(self, surrogate: Surrogate, kind: str) -> list[Draws]:
        """By NUTS on a surrogate, corrected: a walk, and longer ones where it mixes slowly."""
        density = jax.tree_util.Partial(Surrogate.log_density, surrogate)
        given = self.exact, density, self.parameters, self.chains, self.warmup, self.draws, self.seed
        made, longer = [delayed_acceptance.corrected(*given, progress=self.tell(kind))], 1
        for _ in range(_LONGER):
            slow = slowness(made[-1], np.asarray(self.marginal.scale))
            if slow <= 1.0 or longer == _LONGEST or slow * longer > _HOPELESS * _LONGEST:
                break
            longer = int(np.ceil(min(max(_SPARE * slow, 2.0) * longer, _LONGEST)))
            tell = self.tell(f"{kind}, {longer} times as long")
            made.append(delayed_acceptance.corrected(*given, longer, progress=tell))
        return made

    def by_independence(self) -> tuple[Draws | None, str]:
        """By an independence sampler, if it can, and the reason if its draws are not reliable."""
        tell = self.tell("independence sampler")
        try:
            made = independence.sample(self.exact, self.parameters, self.chains, self.draws, self.seed, progress=tell)
        except FloatingPointError as error:
            return None, str(error)
        kept = {name: row for name, row in made.stats.items() if name != "log_ratio"}  # not the surrogate's
        return replace(made, stats=kept), why_not_trusted(made)

    def by_emcee(self, most: int = 20_000) -> Draws:
        """By ensembles of walkers."""
        tell = self.tell("emcee")
        return ensemble.sample(self.exact, self.parameters, self.chains, self.draws, self.seed, BATCH, most, tell)
