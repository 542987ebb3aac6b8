"""Directions from numbers: each `sample_x(…, u)` stands next to its density `pdf_x`.

`u` is any pair of numbers in [0, 1): u[0] turns about the axis, u[1] moves away from it. Vectors are (3,),
axes and normals have unit length, densities are per steradian. Values and derivatives are finite for every u,
0 included. The dtype is that of the arguments. The caller chooses whether u and directions carry derivatives.
"""

import math

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import safe_divide, safe_sqrt

Pair = Array | tuple[Array, Array]  # (2,) or two scalars, in [0, 1)

# Minimax fits on |w| <= 1/4 of sin(2πw)/w and (cos(2πw) - 1)/w² in powers of w²; absolute errors below 4e-9
_SIN_2PI = (6.283185005, -41.341655731, 81.600982666, -76.549171448, 39.531803131)
_COS_2PI = (-19.739208221, 64.939353943, -85.453811646, 60.147827148, -25.004028320)


def sincos_2pi(u: Array) -> tuple[Array, Array]:
    """Return (cos 2πu, sin 2πu), cosine first, for u in [0, 1]: to 3e-7 in float32, and vectorisable."""
    if u.dtype != jnp.float32:
        return jnp.cos(2 * math.pi * u), jnp.sin(2 * math.pi * u)

    # Fold the turn about its half, then its quarter: cos 2πu = -sin 2πw, sin 2πu = ±cos 2πw, |w| <= 1/4
    v = u - 0.5
    sign = jnp.where(v < 0, -1, 1).astype(u.dtype)
    w = 0.25 - sign * v
    cos = -w * _polynomial(_SIN_2PI, w * w)
    return cos, -sign * (1 + w * w * _polynomial(_COS_2PI, w * w))


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    value = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        value = value * x + c
    return value


def frame(n: Array) -> tuple[Array, Array]:
    """Return unit (t, b) that make (t, b, n) right-handed and orthonormal, any unit n (Duff et al. 2017)."""
    t, b = frame_of(n[0], n[1], n[2])
    return jnp.stack(t), jnp.stack(b)


def frame_of(x: Array, y: Array, z: Array) -> tuple[list[Array], list[Array]]:
    """Return `frame` of a normal's components, as components."""
    sign = jnp.where(z >= 0, 1, -1).astype(z.dtype)
    a = -1 / (sign + z)
    xy = x * y * a
    return [1 + sign * x * x * a, sign * xy, -sign * x], [xy, sign + y * y * a, -y]


def around(axis: Array, sin: Array, cos: Array, turn: Array) -> Array:
    """Return the unit direction at the angle of (sin, cos) from `axis`, `turn` of a circle about it."""
    t, b = frame(axis)
    cos_turn, sin_turn = sincos_2pi(turn)
    return (sin * cos_turn) * t + (sin * sin_turn) * b + cos * axis


def sample_cosine_hemisphere(n: Array, u: Pair) -> Array:
    """Return a unit direction above the surface of unit normal n, with density cosθ/π (Lambert's law).

    With a diffuse lobe albedo/π the weight f·cosθ/pdf is the albedo; as a quotient it is 0/0 at cosθ = 0.
    """
    return around(n, safe_sqrt(1 - u[1]), safe_sqrt(u[1]), u[0])


def numbers_of_direction(n: Array, direction: Array) -> tuple[Array, Array]:
    """Return the pair u for which `sample_cosine_hemisphere(n, u)` is a direction above the surface."""
    t, b = frame(n)
    x, y, z = (a[0] * direction[0] + a[1] * direction[1] + a[2] * direction[2] for a in (t, b, n))
    turn = jnp.arctan2(y, x) / (2 * math.pi)
    return jnp.clip(turn - jnp.floor(turn), 0, 1), jnp.clip(z * z, 0, 1)


def pdf_cosine_hemisphere(cos: Array) -> Array:
    """Return the density cosθ/π, 0 below the surface."""
    return jnp.maximum(cos, 0) / math.pi


def sample_uniform_sphere(u: Pair) -> Array:
    """Return a unit direction, all equally likely."""
    # 2√(u(1-u)) is √(1 - (1-2u)²) without its cancellation near the poles
    r = 2 * safe_sqrt(u[1] * (1 - u[1]))
    cos, sin = sincos_2pi(u[0])
    return jnp.stack([r * cos, r * sin, 1 - 2 * u[1]])


def pdf_uniform_sphere() -> float:
    """Return the density 1/4π."""
    return 1 / (4 * math.pi)


def cone_of_sphere(s_squared: Array) -> Array:
    """Return 1 - cosθmax of the cone in which a sphere is seen, s = radius/distance; 1 from inside.

    Written s²/(1 + √(1-s²)), right to rounding for every s: 1 - cosθmax has no digit right at s = 2e-4.
    """
    s2 = jnp.minimum(s_squared, 1)
    return s2 / (1 + safe_sqrt(1 - s2))


def sample_cone(axis: Array, one_minus_cos_max: Array, u: Pair) -> Array:
    """Return a unit direction in the cone about a unit axis, all equally likely."""
    x = one_minus_cos_max * u[1]
    return around(axis, safe_sqrt(x * (2 - x)), 1 - x, u[0])


def pdf_cone(one_minus_cos_max: Array) -> Array:
    """Return the density 1/(2π(1-cosθmax)) inside the cone, and 0 for a cone of no width."""
    return safe_divide(jnp.full_like(one_minus_cos_max, 0.5 / math.pi), one_minus_cos_max)


def sample_visible_cap(axis: Array, s: Array, u: Pair) -> Array:
    """Return the unit normal at a point of a sphere's visible cap, uniform over the cap's projected disk.

    axis: unit, from the centre to the eye; s = radius/distance in [0, 1]; the cap is axis·normal >= s.
    """
    sin2 = (1 - s * s) * (1 - u[1])
    return around(axis, safe_sqrt(sin2), safe_sqrt(1 - sin2), u[0])


def pdf_visible_cap(cos: Array, s: Array) -> Array:
    """Return the density z/(π(1-s²)) per steradian of normals, z = cos = axis·normal; 0 off the cap."""
    disk = jnp.maximum(1 - s * s, 0)
    return jnp.where(cos >= s, safe_divide(cos, math.pi * disk), 0)
