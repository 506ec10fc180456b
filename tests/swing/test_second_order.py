"""The linear pendulum in the frequency domain: closed forms, a time-domain twin, honest errors."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from bayeschute.core.errors import InputError
from bayeschute.swing.fourier import harmonics
from bayeschute.swing.second_order import (
    ENDS,
    JUMPS,
    respond,
    second_order_equation_error,
    second_order_output_error,
)

DT, N = 0.1, 600
T = (N - 1) * DT
t = np.arange(N) * DT
TWO_B, STIFFNESS, GAIN = 0.06, 0.18, 0.5
BAND = harmonics(T, 0.02, 0.2)


def walk(seed):
    return np.cumsum(np.random.default_rng(seed).standard_normal(N)) * 0.05


def test_free_motion_is_the_closed_form():
    b = TWO_B / 2.0
    w = np.sqrt(STIFFNESS - b * b)  # 6.3.1-25..28
    wanted = np.exp(-b * t) * ((0.1 + b * 0.3) / w * np.sin(w * t) + 0.3 * np.cos(w * t))
    made = respond(STIFFNESS, TWO_B, (0.3, 0.1), np.zeros(N), DT)
    np.testing.assert_allclose(made.angle, wanted, atol=1e-11)
    np.testing.assert_allclose(np.gradient(made.angle, DT)[1:-1], made.rate[1:-1], atol=1e-4)


@pytest.mark.parametrize(("two_b", "stiffness"), [(0.06, 0.18), (-0.05, 0.2), (2.0, 0.3), (0.0, 0.0)])
def test_forced_motion_is_that_of_an_integrator(two_b, stiffness):
    u = walk(3)[:80]

    def rate(s, x):
        return [x[1], np.interp(s, t, np.r_[u, np.zeros(N - 80)]) - two_b * x[1] - stiffness * x[0]]

    wanted = solve_ivp(rate, (0.0, t[79]), [0.2, -0.1], t_eval=t[:80], rtol=1e-9, atol=1e-11, max_step=DT).y
    made = respond(stiffness, two_b, (0.2, -0.1), u, DT)
    np.testing.assert_allclose(np.stack([made.angle, made.rate]), wanted, atol=1e-6)


@pytest.mark.parametrize("frequency", [BAND, np.linspace(0.021, 0.19, 25)])
@pytest.mark.parametrize("forced", [True, False])
def test_equation_error_is_exact_without_noise(frequency, forced):
    """Free decay and forced motion, neither periodic: end terms take up what leaks."""
    u = np.sin(0.37 * t) + 0.3 * np.sin(0.71 * t + 1.0)
    x = respond(STIFFNESS, TWO_B, (0.2, 0.05), GAIN * u if forced else 0.0 * u, DT).angle
    made = second_order_equation_error(x, DT, frequency, u if forced else None)
    assert made.value("two_b") == pytest.approx(TWO_B, abs=2e-5)
    assert made.value("stiffness") == pytest.approx(STIFFNESS, abs=2e-5)
    if forced:
        assert made.value("gain") == pytest.approx(GAIN, abs=2e-4)
    assert set(made.names[-2:]) <= set(JUMPS) or made.names[-4:] == ENDS
    if made.names[-4:] == ENDS:
        assert made.value("start_value") == pytest.approx(0.2, abs=1e-3)


def test_output_error_is_exact_without_noise_from_rates_and_angles():
    motion = respond(STIFFNESS, TWO_B, (0.2, 0.05), np.zeros(N), DT)
    for data, seen in ((motion.rate, ("rate",)), (np.column_stack(motion), ("angle", "rate"))):
        made = second_order_output_error(data, DT, BAND, seen=seen)
        assert made.converged
        np.testing.assert_allclose(made.estimate, [TWO_B, STIFFNESS, 0.2, 0.05], atol=1e-6)


def test_time_domain_twin():
    """Leaving out zero frequency is an unknown offset of the output in time; white noise is white in both domains."""
    u, rng = walk(5), np.random.default_rng(2)
    y = respond(STIFFNESS, TWO_B, (0.2, 0.0), GAIN * u, DT).angle + 0.03 * rng.standard_normal(N)

    def residual(p):
        return respond(p[1], p[0], (p[3], p[4]), p[2] * u, DT).angle + p[5] - y

    twin = least_squares(residual, [TWO_B, STIFFNESS, GAIN, 0.2, 0.0, 0.0], x_scale=[0.1, 0.1, 1.0, 0.1, 0.1, 0.1])
    twin_se = np.sqrt(np.diag(np.linalg.inv(twin.jac.T @ twin.jac)) * 2.0 * twin.cost / (N - 6))
    start = second_order_equation_error(y, DT, BAND, u)
    made = second_order_output_error(y, DT, harmonics(T, 0.001, 1.0), u, start=start)  # above, noise alone
    assert made.converged
    np.testing.assert_array_less(np.abs(made.estimate - twin.x[:5])[:3], 0.5 * twin_se[:3])
    np.testing.assert_allclose(made.se[:3], twin_se[:3], rtol=0.35)


def scores(estimate, n=60):
    out = []
    for seed in range(n):
        made = estimate(np.random.default_rng(seed))
        truth = {"two_b": TWO_B, "stiffness": STIFFNESS, "gain": GAIN}
        out.append([(made.value(k) - v) / made.error(k) for k, v in truth.items()])
    return np.array(out)


def noisy(rng, u):
    return respond(STIFFNESS, TWO_B, (0.2, 0.0), GAIN * u, DT).angle + 0.02 * rng.standard_normal(N)


def test_errors_are_honest_where_the_noise_is_of_the_sensor():
    u = walk(7)
    z = scores(lambda rng: second_order_output_error(noisy(rng, u), DT, BAND, u), 25)
    assert (np.abs(z.mean(axis=0)) < 0.7).all() and (np.abs(z.std(axis=0) - 1.0) < 0.45).all()


def test_errors_are_honest_where_the_noise_is_forcing():
    u = walk(9)

    def estimate(rng):
        gusts = 0.07 * rng.standard_normal(N)
        x = respond(STIFFNESS, TWO_B, (0.2, 0.0), GAIN * u + gusts, DT).angle
        return second_order_equation_error(x, DT, BAND, u)

    z = scores(estimate)
    assert (np.abs(z.mean(axis=0)) < 0.5).all() and (np.abs(z.std(axis=0) - 1.0) < 0.3).all()


def test_frequencies_closer_than_harmonics_promise_nothing_more():
    u = walk(7)
    y = noisy(np.random.default_rng(0), u)
    coarse = second_order_equation_error(y, DT, BAND, u)
    fine = second_order_equation_error(y, DT, np.linspace(BAND[0], BAND[-1], 6 * BAND.size), u)
    assert fine.repeats == pytest.approx(6.0, rel=0.1)
    np.testing.assert_allclose(fine.se[:3], coarse.se[:3], rtol=0.5)


def test_several_forcings_have_a_gain_each():
    u = np.column_stack([walk(1), walk(2)])
    x = respond(STIFFNESS, TWO_B, (0.0, 0.0), u @ [0.5, -0.2], DT).angle
    made = second_order_equation_error(x, DT, BAND, u)
    np.testing.assert_allclose([made.value("gain_1"), made.value("gain_2")], [0.5, -0.2], atol=1e-3)


def test_bad_input():
    x = np.sin(t)
    with pytest.raises(InputError, match="as many as the response"):
        second_order_equation_error(x, DT, BAND, np.ones(5))
    with pytest.raises(InputError, match="'angle' or 'rate'"):
        second_order_output_error(x, DT, BAND, seen=("speed",))
    with pytest.raises(InputError, match="Widen the band"):
        second_order_equation_error(x, DT, BAND[:2])
