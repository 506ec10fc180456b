"""Vectors and rotations, component by component, so that XLA can fuse a whole right-hand side.

A component is an array of any shape (a canopy axis first, batch axes last); operations broadcast like NumPy's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax

from bayeschute.core.array_library import library_of

Component = Any  # jax.Array, numpy.ndarray or float: whatever broadcasts


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Vec3:
    """A vector by components along three orthogonal axes; any unit."""

    x: Component
    y: Component
    z: Component

    def __add__(self, other: Vec3) -> Vec3:
        """Sum of two vectors."""
        return Vec3(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vec3) -> Vec3:
        """Difference of two vectors."""
        return Vec3(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> Vec3:
        """The opposite vector."""
        return Vec3(-self.x, -self.y, -self.z)

    def __mul__(self, scale: Component) -> Vec3:
        """Product with a scalar."""
        return Vec3(self.x * scale, self.y * scale, self.z * scale)

    __rmul__ = __mul__

    def __truediv__(self, scale: Component) -> Vec3:
        """Quotient by a scalar."""
        inverse = 1.0 / scale
        return Vec3(self.x * inverse, self.y * inverse, self.z * inverse)

    def map(self, function: Any) -> Vec3:
        """Apply a function to every component."""
        return Vec3(function(self.x), function(self.y), function(self.z))

    def stack(self) -> Component:
        """The components on a new leading axis."""
        return _stacked(self.x, self.y, self.z)


def _stacked(*parts: Component) -> Component:
    library = library_of(*parts)
    return library.stack(library.broadcast_arrays(*parts))


def vec3(array: Component) -> Vec3:
    """A vector from an array with the components on its leading axis."""
    return Vec3(array[0], array[1], array[2])


def dot(a: Vec3, b: Vec3) -> Component:
    """Scalar product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Vector product."""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def norm(a: Vec3, least: float = 0.0) -> Component:
    """Length; `least` keeps the gradient finite where the vector may vanish."""
    square = dot(a, a) + least * least
    return library_of(square).sqrt(square)


def perpendicular(a: Vec3, axis: Vec3) -> Vec3:
    """The part of `a` across the unit vector `axis`: (I - axis axis^T) a."""
    return a - axis * dot(a, axis)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Quaternion:
    """Attitude as a unit quaternion (scalar first), body relative to NED; ``R_bn v`` is `to_body`."""

    w: Component
    x: Component
    y: Component
    z: Component

    def to_body(self, v: Vec3) -> Vec3:
        """Components from NED to body: the product ``R_bn v``."""
        return self._rotate(v, -1.0)

    def to_ned(self, v: Vec3) -> Vec3:
        """Components from body to NED: the product ``R_bn^T v``."""
        return self._rotate(v, 1.0)

    def _rotate(self, v: Vec3, sign: float) -> Vec3:
        axis = Vec3(self.x, self.y, self.z) * sign
        twice = cross(axis, v) * 2.0
        return v + twice * self.w + cross(axis, twice)

    def rate(self, omega_b: Vec3) -> Quaternion:
        """Time derivative under the body rate `omega_b` [rad/s]."""
        p, q, r = omega_b.x, omega_b.y, omega_b.z
        return Quaternion(
            0.5 * (-self.x * p - self.y * q - self.z * r),
            0.5 * (self.w * p + self.y * r - self.z * q),
            0.5 * (self.w * q + self.z * p - self.x * r),
            0.5 * (self.w * r + self.x * q - self.y * p),
        )

    def times(self, other: Quaternion) -> Quaternion:
        """Quaternion product: first `self`, then `other` in the axes that `self` leads to."""
        a, b = Vec3(self.x, self.y, self.z), Vec3(other.x, other.y, other.z)
        v = b * self.w + a * other.w + cross(a, b)
        return Quaternion(self.w * other.w - dot(a, b), v.x, v.y, v.z)

    def conjugate(self) -> Quaternion:
        """The opposite rotation."""
        return Quaternion(self.w, -self.x, -self.y, -self.z)

    def normalised(self) -> Quaternion:
        """The same direction at unit length."""
        square = self.w**2 + self.x**2 + self.y**2 + self.z**2
        scale = 1.0 / library_of(square).sqrt(square)
        return Quaternion(self.w * scale, self.x * scale, self.y * scale, self.z * scale)

    def stack(self) -> Component:
        """Scalar part, then vector part, on a new leading axis."""
        return _stacked(self.w, self.x, self.y, self.z)


def quaternion(array: Component) -> Quaternion:
    """A quaternion from an array with (w, x, y, z) on its leading axis."""
    return Quaternion(array[0], array[1], array[2], array[3])


def small_rotation(rotation: Vec3) -> Quaternion:
    """The unit quaternion of a rotation vector [rad]; smooth at zero."""
    half = rotation * 0.5
    w = library_of(half.x).ones_like(half.x)
    # A Rodrigues vector scaled to unit length: exact direction, angle 2 atan(|half|), |rotation| to third order.
    return Quaternion(w, half.x, half.y, half.z).normalised()
