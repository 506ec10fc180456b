"""Laws of vectors and quaternions."""

from __future__ import annotations

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from bayeschute.core.vectors import Vec3, cross, dot, norm, perpendicular, quaternion, small_rotation, vec3

RNG = np.random.default_rng(0)
A, B = RNG.normal(size=(3, 50)), RNG.normal(size=(3, 50))
Q, P = (q / np.linalg.norm(q, axis=0) for q in RNG.normal(size=(2, 4, 50)))


def test_products_equal_numpys():
    a, b = vec3(A), vec3(B)
    np.testing.assert_allclose(dot(a, b), np.sum(A * B, axis=0))
    np.testing.assert_allclose(cross(a, b).stack(), np.cross(A, B, axis=0))
    np.testing.assert_allclose((a + b * 2.0 - a / 4.0 + (-b)).stack(), 0.75 * A + B)
    np.testing.assert_allclose(norm(a), np.linalg.norm(A, axis=0))


def test_perpendicular_part_is_across_and_stays():
    axis = vec3(B) / np.linalg.norm(B, axis=0)
    across = perpendicular(vec3(A), axis)
    np.testing.assert_allclose(dot(across, axis), 0.0, atol=1e-14)
    np.testing.assert_allclose(perpendicular(across, axis).stack(), across.stack(), atol=1e-14)


def test_norm_keeps_a_finite_gradient_at_zero():
    slope = jax.grad(lambda v: norm(vec3(v), 1e-3))(np.zeros(3))
    np.testing.assert_array_equal(slope, 0.0)


def test_rotations_equal_matrices_and_undo_each_other():
    q, v = quaternion(Q), vec3(A)
    R = Rotation.from_quat(Q.T, scalar_first=True).as_matrix()
    np.testing.assert_allclose(q.to_ned(v).stack(), np.einsum("bij,jb->ib", R, A), atol=1e-14)
    np.testing.assert_allclose(q.to_body(q.to_ned(v)).stack(), A, atol=1e-14)
    np.testing.assert_allclose(q.conjugate().to_ned(v).stack(), q.to_body(v).stack(), atol=1e-14)
    np.testing.assert_allclose(dot(q.to_ned(v), q.to_ned(vec3(B))), np.sum(A * B, axis=0), atol=1e-13)


def test_the_product_rotates_in_turn_and_keeps_length():
    both, v = quaternion(P).times(quaternion(Q)), vec3(A)
    np.testing.assert_allclose(
        both.to_ned(v).stack(), quaternion(P).to_ned(quaternion(Q).to_ned(v)).stack(), atol=1e-13
    )
    np.testing.assert_allclose(np.linalg.norm(both.stack(), axis=0), 1.0)
    one = quaternion(Q).times(quaternion(Q).conjugate())
    np.testing.assert_allclose(one.stack(), np.array([[1.0], [0], [0], [0]]) * np.ones(50), atol=1e-14)


def test_the_rate_is_the_derivative_of_a_turning_body():
    """d/dt (q to_ned v) = q to_ned (omega x v), and the length of q doesn't change."""
    q, omega, v = quaternion(Q), vec3(B), vec3(A)
    rate = q.rate(omega)
    np.testing.assert_allclose(np.sum(np.asarray(q.stack()) * np.asarray(rate.stack()), axis=0), 0.0, atol=1e-14)
    got = jax.jvp(lambda s: quaternion(s).to_ned(v).stack(), (Q,), (np.asarray(rate.stack()),))[1]
    np.testing.assert_allclose(got, q.to_ned(cross(omega, v)).stack(), atol=1e-13)


def test_small_rotations_are_unit_have_exact_axes_and_third_order_angles():
    axis = np.array([0.6, 0.0, 0.8])
    assert np.isfinite(jax.jacfwd(lambda v: small_rotation(vec3(v)).stack())(np.zeros(3))).all()
    for angle in (0.0, 1e-3, 0.1):
        q = np.asarray(small_rotation(vec3(axis * angle)).stack())
        np.testing.assert_allclose(np.linalg.norm(q), 1.0)
        want = np.concatenate([[np.cos(angle / 2)], axis * np.sin(angle / 2)])
        np.testing.assert_allclose(q, want, atol=angle**3 / 20)


def test_normalised_keeps_direction():
    np.testing.assert_allclose(quaternion(3.0 * Q).normalised().stack(), Q)


def test_components_broadcast():
    assert Vec3(np.zeros(4), 1.0, 2.0).stack().shape == (3, 4)
