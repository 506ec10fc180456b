"""Tension of an elastic, damped riser that carries no compression (report 6.3.3-1..3)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from bayeschute.core.vectors import Component


def _engaged(x: Component) -> Component:
    """Share of the lines that are taut at a share x of the engagement: from 0 to exactly 1."""
    return jnp.where(x < 1.0, x * x * (3.0 - 2.0 * x), 1.0)


def taut_share(stretch: Component, engagement: Component) -> Component:
    """Share of the lines of a riser that are taut: 0 when slack, exactly 1 beyond the engagement."""
    return _engaged(jnp.maximum(stretch / engagement, 0.0))


@jax.custom_jvp
def riser_tension(
    stretch: Component, stretch_rate: Component, stiffness: Component, damping: Component, engagement: Component
) -> Component:
    """Tension T = r max(0, k s + c s') of a riser stretched by s, 0 when slack [N].

    r = 3 x^2 - 2 x^3 with x = s/engagement, and exactly 1 beyond: lines of a riser come taut one after another. Were
    all there at once, the tension would jump by c s' where s = 0, and derivatives of a flight would miss that
    parameters move the moment at which a riser comes taut. With r the rate of the state is smooth there.

    The derivative is written out below: that of nested maxima takes half of the time of a flight's Jacobian.

    Args:
        stretch: s, negative when slack [m].
        stretch_rate: s' [m/s].
        stiffness: k [N/m].
        damping: c [N s/m].
        engagement: Stretch at which all lines are taut [m].
    """
    force = stiffness * stretch + damping * stretch_rate
    return jnp.where((stretch > 0.0) & (force > 0.0), _engaged(stretch / engagement) * force, 0.0)


@riser_tension.defjvp
def _derivative(values: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Component, Component]:
    stretch, rate, stiffness, damping, engagement = values
    d_stretch, d_rate, d_stiffness, d_damping, d_engagement = tangents
    x = stretch / engagement
    force = stiffness * stretch + damping * rate
    pulls = (stretch > 0.0) & (force > 0.0)
    share = jnp.where(pulls, _engaged(x), 0.0)
    steep = jnp.where(pulls & (x < 1.0), 6.0 * x * (1.0 - x) * force / engagement, 0.0)
    change = (share * stiffness + steep) * d_stretch + (share * damping) * d_rate
    change = change + (share * stretch) * d_stiffness + (share * rate) * d_damping
    return share * force, change - (steep * x) * d_engagement
