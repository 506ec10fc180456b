"""Laws between a record and its vehicle: lengths of risers, balance of forces, density of the air, wind."""

from __future__ import annotations

import numpy as np

from bayeschute.atmosphere.standard import (
    GAS_CONSTANT_DRY_AIR,
    HIGHEST,
    LOWEST,
    STANDARD_GRAVITY,
    pressure_altitude,
    standard_density,
)
from bayeschute.records.plausibility.evidence import Array, Evidence, smoothed, spread, turned, typical
from bayeschute.records.plausibility.motion_laws import earth_force, over_lag
from bayeschute.records.plausibility.reading import Reading, reading
from bayeschute.records.plausibility.scatter import scatter

_SWING = 30.0  # over which swing and glide average out [s]
_DRAG = 0.75  # coefficient of a canopy, about
_CONSTANT = 3.0  # times the scatter of canopies' samples: constant error of where they are seen


def count(e: Evidence) -> list[Reading]:
    """As many canopies in the record as the vehicle has."""
    if e.vehicle is None:
        return []
    out = []
    for name, values in (("canopies", e.canopies), ("load cells", e.tension)):
        if values is not None:
            n, wanted = values.shape[1], e.vehicle.canopies
            tests = f"number of {name} in the record against canopies of the vehicle"
            law = f"count.{name.replace(' ', '_')}"
            out.append(Reading(law, tests, 2.0 * abs(n - wanted), f"{n}", f"{wanted}"))
    return out


def sizes(e: Evidence) -> list[Reading]:
    """Area, diameter and volume of a canopy belong together, so do mass, inertia and length of the capsule."""
    v = e.vehicle
    if v is None:
        return []
    circle = np.log(v.area / (0.25 * np.pi * v.diameter**2))
    out = reading("size.area", "area of a canopy against its diameter", circle, 0.6, "a factor exp({:+.2f})", "about 1")
    bulk = np.log(v.volume / v.area**1.5 / 0.12)
    tests = "volume of a canopy against its area"
    out += reading("size.volume", tests, bulk, 1.5, "a factor exp({:+.2f})", "0.12 area^1.5 within a factor of 4")
    gyration = np.log(np.sqrt(np.median(v.inertia) / v.mass) / v.capsule_length / 0.28)
    tests = "radius of gyration of the capsule against its length"
    out += reading("size.inertia", tests, gyration, 1.1, "a factor exp({:+.2f})", "0.1 to 0.8 of the length")
    thick = np.log(v.riser_length / v.diameter / 1.6)
    tests = "riser and line length against diameter of a canopy"
    return out + reading("size.riser", tests, thick, 1.3, "a factor exp({:+.2f})", "0.4 to 6 diameters")


def attached(e: Evidence) -> Array | None:
    """From the attach point, or the capsule where that is not known, to every canopy, NED (T, n, 3) [m]."""
    if e.canopies is None or e.position is None:
        return None
    attach = 0.0 if e.attitude is None or e.vehicle is None else turned(e.attitude, e.vehicle.attach_b)
    return np.asarray(e.canopies - (e.position + attach)[:, None])


def risers(e: Evidence) -> list[Reading]:
    """Distance of attach point and canopies is the length of the risers, at all times."""
    r = attached(e)
    if r is None or e.vehicle is None:
        return []
    length = np.linalg.norm(r, axis=2)
    stretch = e.vehicle.mass * STANDARD_GRAVITY / (r.shape[1] * e.vehicle.stiffness)
    ratio = np.array([typical(x) for x in length.T]) / (e.vehicle.riser_length + min(stretch, 5.0))
    if not np.isfinite(ratio).any():
        return []
    worst = float(ratio[np.nanargmax(np.abs(np.log(ratio)))])
    tests = "distance of attach point and canopies against the length of the risers"
    got = f"{worst:.3g} of it"
    out = [Reading("riser.length", tests, abs(np.log(worst)) / 0.06, got, "0.94 to 1.06 of it")]
    scatter = spread(length - np.nanmedian(length, axis=0)) / e.vehicle.riser_length
    tests = "scatter of the distance of attach point and canopies"
    return out + reading("riser.scatter", tests, scatter, 0.03, "{:.3f} of the risers' length")


def pull(e: Evidence) -> list[Reading]:
    """The capsule is pulled along its risers; load cells say how strongly.

    Where canopies are seen as well as their samples scatter, a constant error turns the risers by some times that over
    their length: of little account on risers of 70 m, of a few per cent on those of 3 m.
    """
    r, f = attached(e), earth_force(e)
    v = e.vehicle
    if r is None or f is None or v is None:
        return []
    along = over_lag(e, r / np.linalg.norm(r, axis=2, keepdims=True))
    seen = np.isfinite(along).all(axis=(1, 2)) & np.isfinite(f).all(axis=1)
    if seen.sum() < 20:
        return []
    n, g = along[seen].transpose(0, 2, 1), v.mass * f[seen]
    if n.shape[2] > 1:  # tensions of least squares, held to be about equal: three risers are nearly in a plane
        weak = 0.02 * np.eye(n.shape[2])
        gram = n.transpose(0, 2, 1) @ n
        equal = np.linalg.norm(g, axis=1)[:, None, None] / n.shape[2] * np.ones((n.shape[2], 1))
        t = np.linalg.solve(gram + weak, n.transpose(0, 2, 1) @ g[..., None] + weak @ equal)
    else:
        t = n.transpose(0, 2, 1) @ g[..., None]
    left = (g[..., None] - n @ t)[..., 0]
    share = spread(left) * np.sqrt(3.0) / (v.mass * STANDARD_GRAVITY)
    tests = "direction of the capsule's acceleration less gravity against the risers"
    swing = spread(g[:, :2]) * np.sqrt(2.0) / (v.mass * STANDARD_GRAVITY)
    apart = np.array([scatter(x) for x in r.reshape(len(r), -1).T]) / typical(np.linalg.norm(r, axis=2))
    most = 0.02 + 0.15 * swing + _CONSTANT * np.nan_to_num(typical(apart))
    out = reading("pull.direction", tests, share, most, "{:.3f} of the weight across them")
    if e.tension is None or e.tension.shape[1] != n.shape[2]:
        return out
    cells = over_lag(e, e.tension)[seen]
    total = np.linalg.norm(g, axis=1) / np.linalg.norm(np.einsum("tck,tk->tc", n, cells), axis=1)
    ratio = 1.0 / typical(total) if np.isfinite(typical(total)) else np.nan
    tests = "load cells against mass times acceleration less gravity"
    got = f"{ratio:.3g} of it"
    out += [
        x._replace(got=got)
        for x in reading("pull.size", tests, np.log(max(abs(ratio), 1e-9)), 0.18, "{}", "0.84 to 1.2 of it")
    ]
    if n.shape[2] == 2:
        unlike, said = t[:, 0, 0] - t[:, 1, 0], cells[:, 0] - cells[:, 1]
        both = np.isfinite(unlike) & np.isfinite(said)
        if both.sum() > 50 and np.std(said[both]) > 0.0 and np.std(unlike[both]) > 0.0:
            likeness = float(np.corrcoef(unlike[both], said[both])[0, 1])
            tests = "difference of the load cells against that of the risers' pulls"
            excess = max(0.0, -likeness / 0.3)
            out.append(Reading("pull.order", tests, excess, f"a correlation of {likeness:.2f}", "a positive one"))
    return out


def balance(e: Evidence) -> list[Reading]:
    """Drag holds the weight: the coefficient of the canopies that follows is one that canopies have."""
    v = e.vehicle
    velocity, known = e.velocity, _density_of_air(e)
    if v is None or velocity is None or known is None:
        return []
    wind = air(e)
    relative = velocity if wind is None else velocity - np.nan_to_num(wind)
    pressure = 0.5 * known * np.sum(relative**2, axis=1)
    weight = STANDARD_GRAVITY * (v.mass + v.canopies * v.dry_mass)
    ratio = (weight - typical(pressure) * v.capsule_drag * v.capsule_area) / (typical(pressure) * v.canopies * v.area)
    tests = "drag coefficient of the canopies by the vertical balance"
    excess = abs(np.log(max(ratio, 1e-9) / _DRAG)) / np.log(1.9)
    return [Reading("balance.drag", tests, float(excess), f"C_A of about {ratio:.3g}", "0.4 to 1.4")]


def _density_of_air(e: Evidence) -> Array | None:
    """As recorded, else of the recorded pressure and temperature, else of the standard atmosphere (T,) [kg/m^3]."""
    height = e.height()
    if e.density is not None:
        return e.density
    if e.pressure is not None and e.temperature is not None:
        return e.pressure / (GAS_CONSTANT_DRY_AIR * e.temperature)
    return None if height is None else np.asarray(standard_density(np.clip(height, LOWEST, HIGHEST)))


def air(e: Evidence) -> Array | None:
    """Wind at the canopies, NED (T, 3) [m/s]; None: none is known."""
    wind = e.wind if e.wind is not None else e.profile
    return wind if wind is None or e.shear is None else wind + e.shear


def drift(e: Evidence) -> list[Reading]:
    """Over some swings a capsule goes where the wind goes, and a profile says what the record says."""
    wind = air(e)
    out: list[Reading] = []
    if e.vehicle is not None:
        got, wanted = "none" if wind is None else "one", "a wind, recorded or by altitude"
        out.append(Reading("wind.present", "presence of a wind", 1.5 if wind is None else 0.0, got, wanted))
    if wind is None:
        return out
    if e.wind is not None and e.profile is not None:
        apart, size = spread((e.wind - e.profile)[:, :2]), min(spread(e.wind[:, :2]), spread(e.profile[:, :2]))
        tests = "recorded wind against the wind by altitude"
        out += reading("wind.profile", tests, apart, 1.0 + 0.3 * size, "{:.2g} m/s apart")
    velocity = e.velocity
    if velocity is None or e.time[-1] - e.time[0] < 1.5 * _SWING:
        return out
    k = e.samples(_SWING) if e.time[-1] - e.time[0] > 10.0 * _SWING else min(round(_SWING / e.step), e.time.size // 2)
    v, w = (smoothed(x[:, :2], k) for x in (velocity, wind))
    both = np.isfinite(v + w).all(axis=1)
    if both.sum() < 10:
        return out
    v, w = v[both], w[both]
    apart, size = spread(v - w), spread(v)
    tests = "horizontal velocity, averaged over swings, against the wind"
    out += reading("wind.drift", tests, apart, 1.0 + 0.3 * size, "{:.2g} m/s apart")
    moved, blown = v[:, 0] + 1j * v[:, 1], w[:, 0] + 1j * w[:, 1]
    slope = np.vdot(blown, moved) / (np.vdot(blown, blown).real + 0.5 * blown.size)
    loose = 0.35 + 1.0 / max(size, 0.1)
    got = f"{abs(slope):.2f} of it, turned by {np.rad2deg(np.angle(slope)):.0f} deg"
    return [*out, Reading("wind.share", "drift per wind", float(abs(slope - 1.0) / loose), got, "about all of it")]


def density(e: Evidence) -> list[Reading]:
    """Density is that of an atmosphere at that altitude, and that of a gas of that pressure and temperature."""
    out = []
    height = e.height()
    if e.density is not None and e.pressure is not None and e.temperature is not None:
        gas = e.pressure / (GAS_CONSTANT_DRY_AIR * e.temperature)
        far = np.log(typical(e.density / gas))
        out += reading(
            "density.gas", "density against pressure and temperature", far, 0.05, "a factor exp({:+.3f})", "1"
        )
    if height is None:
        return out
    inside = np.clip(height, LOWEST, HIGHEST)
    known = e.density
    if known is None and e.pressure is not None and e.temperature is not None:
        known = e.pressure / (GAS_CONSTANT_DRY_AIR * e.temperature)
    if known is not None:
        far = np.log(np.maximum(known, 1e-12) / standard_density(inside))
        tests = "density against altitude (standard atmosphere)"
        out += [
            r._replace(got=f"{np.exp(typical(far)):.3g} of the standard")
            for r in reading("density.level", tests, typical(far), 0.13, "{}", "0.88 to 1.14 of the standard")
        ]
        climb = np.nanmax(inside) - np.nanmin(inside)
        seen = np.isfinite(far) & np.isfinite(height)
        if climb > 500.0 and seen.sum() > 20:
            change = np.polyfit((inside[seen] - inside[seen].mean()) / 1000.0, far[seen], 1)[0]
            tests = "change of density with altitude, less that of the standard atmosphere"
            out += reading("density.slope", tests, float(change), 0.04, "{:+.3f} per km", "-0.04 to 0.04 per km")
    if e.pressure is not None and e.altitude is not None:
        level = pressure_altitude(np.clip(e.pressure, 900.0, 1.7e5))
        tests = "altitude against pressure altitude"
        limit = 350.0 + 0.07 * abs(typical(height))
        out += reading("pressure.altitude", tests, typical(level - e.altitude), limit, "{:.0f} m apart")
    return out


LAWS = (count, sizes, risers, pull, balance, drift, density)
