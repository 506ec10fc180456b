"""Naive twin of the cluster's equations of motion (report 6.3.3 with PHYSICS' corrections): loops and matrices, no JAX.

Also the small cluster and the flight that tests of several rooms share.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import root


def rotation_from_body(q: np.ndarray) -> np.ndarray:
    """R_nb of a unit quaternion: columns are the body axes in NED."""
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def naive_rate(x, n, p, axial, transverse, rate, air):
    """Rate of the state (13 + 6 n,); `p` numbers by name, `axial` and `transverse` pairs (term, coefficient)."""
    r_c, v_c, q, omega = x[0:3], x[3:6], x[6:10], x[10:13]
    places = [x[13 : 13 + 3 * n].reshape(3, n)[:, i] for i in range(n)]
    speeds = [x[13 + 3 * n :].reshape(3, n)[:, i] for i in range(n)]
    R_nb = rotation_from_body(q)
    arm = R_nb @ p["attach_b"]
    v_attach = v_c + R_nb @ np.cross(omega, p["attach_b"])
    canopy_a, pull = [], np.zeros(3)
    for i in range(n):
        line = places[i] - (r_c + arm)
        length = np.linalg.norm(line)
        nn = line / length
        relative = speeds[i] - v_attach
        T = 0.0
        if length > p["l0"]:
            T = max(0.0, p["k"] * (length - p["l0"]) + p["c"] * (nn @ relative))
        xdot = -(relative - nn * (nn @ relative)) / length
        couple = _couple(length, nn, speeds[i], xdot, p, air)
        pull += T * nn + couple
        weight = np.array([0.0, 0.0, p["m_d"] * p["g"]])
        m = p["m_d"] + air["rho"] * p["V_ea"]

        def balance(a, i=i, nn=nn, xdot=xdot, T=T, weight=weight, m=m, couple=couple):
            F = _aerodynamics(i, a, places, speeds, -nn, xdot, p, axial, transverse, rate, air)
            return (weight - T * nn - couple + F) / m - a

        guess = balance(np.zeros(3))
        canopy_a.append(guess if rate == "riser" else root(balance, guess, tol=1e-13).x)
    V = v_c - air["wind"]
    u = R_nb.T @ V / np.linalg.norm(V)
    qS = 0.5 * air["rho"] * (V @ V) * p["S_c"]
    A_b = qS * np.array([-p["C_A"], -p["C_Nslope"] * u[1], -p["C_Nslope"] * u[2]])
    M_b = qS * p["l_c"] * p["C_mslope"] * np.array([0.0, u[2], -u[1]])
    M_b = M_b + qS * p["l_c"] ** 2 / (2 * np.linalg.norm(V)) * np.array([p["C_lp"], p["C_mq"], p["C_mq"]]) * omega
    M_b = M_b + np.cross(p["reference_b"], A_b) + np.cross(p["attach_b"], R_nb.T @ pull)
    inertia = np.asarray(p["inertia"])  # (3, 3)
    a_c = (pull + R_nb @ A_b) / p["m_c"] + np.array([0.0, 0.0, p["g"]])
    turning = np.linalg.solve(inertia, M_b - np.cross(omega, inertia @ omega))
    P, Q, R = omega
    wheel = np.array([[0, -P, -Q, -R], [P, 0, R, -Q], [Q, -R, 0, P], [R, Q, -P, 0]])
    return np.concatenate(
        [v_c, a_c, 0.5 * wheel @ q, turning, np.array(speeds).T.ravel(), np.array(canopy_a).T.ravel()]
    )


def _couple(length, nn, velocity, xdot, p, air):
    """Force on the capsule by a canopy's moment M about its reference point: n x F L = M, F across n."""
    V = velocity - air["wind"]
    speed = np.linalg.norm(V)
    w = V / speed
    turning = p["k_mslope"] * np.cross(-nn, w)
    turning = turning + p["k_mq"] * p["l"] / (2 * speed) * (-nn @ w) * np.cross(-nn, -xdot)
    M = 0.5 * air["rho"] * speed**2 * p["S"] * p["l"] * turning
    share = np.clip((length - p["l0"]) / p["engagement"], 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share) * np.cross(M, nn) / length


def _aerodynamics(i, a, places, speeds, axis, xdot, p, axial, transverse, rate, air):
    """Force on canopy i that accelerates with a, q S (-C_A x + transverse) (6.3.3-5)."""
    V = speeds[i] - air["wind"]
    speed = np.linalg.norm(V)
    w = V / speed
    cos = w @ axis
    P = np.eye(3) - np.outer(axis, axis)
    e = P @ w
    alpha = np.arctan2(np.linalg.norm(e), cos)
    r = -cos * xdot
    if rate == "airflow":
        r = r + P @ (np.eye(3) - np.outer(w, w)) @ (a - air["wind_rate"]) / speed
    r = r * p["l"] / (2 * speed)
    q = 0.5 * air["rho"] * speed**2
    pairs = []
    for j in range(len(places)):
        if j != i:
            apart = places[i] - places[j]
            d = np.linalg.norm(apart)
            pairs.append((P @ apart / d, d / p["l"], (apart / d) @ (speeds[i] - speeds[j]) / p["l"]))

    def number(factor, pair):
        if factor == "1":
            return 1.0
        if factor.startswith("alpha"):
            return alpha ** int(factor[6:] or 1)
        if factor.startswith("restoring"):
            return max(alpha - np.deg2rad(float(factor[10:-1])), 0.0) ** 2
        if factor.startswith("proximity"):
            return max(float(factor[10:-1]) - pair[1], 0.0)
        if factor == "speed":
            return speed / p["V_o"] - 1.0
        values = {"q": q / (0.5 * 1.225 * p["V_o"] ** 2), "(e.rate)": e @ r}
        if pair:
            values |= {"closing": pair[2], "(e.c)": e @ pair[0], "(c.rate)": pair[0] @ r}
        return values[factor]

    def arrow(factor, pair):
        if factor == "e":
            return -e
        if factor == "angle":
            return -alpha * e / np.linalg.norm(e)
        if factor == "rate":
            return -r
        if factor == "c":
            return pair[0]
        return pair[0] * max(float(factor[10:-1]) - pair[1], 0.0) if factor.startswith("repulsion") else None

    def whole(name, vector):
        factors = name.split("*")
        paired = any(f in ("c", "closing", "(e.c)", "(c.rate)") or f[:5] in ("repul", "proxi") for f in factors)
        total = np.zeros(3) if vector else 0.0
        for pair in pairs if paired else [None]:
            value, direction = 1.0, None
            for f in factors:
                if f in ("e", "angle", "rate", "c") or f.startswith("repulsion"):
                    direction = arrow(f, pair)
                elif f != "side":
                    value *= number(f, pair)
            if vector:
                total = total + value * (np.cross(axis, direction) if "side" in factors else direction)
            else:
                total = total + value
        return total

    C_A = sum(value * whole(name, False) for name, value in axial) * air["factor"][i]
    C_t = sum((value * whole(name, True) for name, value in transverse), np.zeros(3))
    return q * p["S"] * (-C_A * axis + C_t)
