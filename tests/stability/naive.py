"""Textbook methods that fail: tests show first that their scenes break them. One lane each."""

import jax.numpy as jnp

from jaxrt.core.maths import FAR, cross, dot


def textbook_sphere(o, d, c, r):
    """b² − 4ac of the expanded quadratic."""
    f = o - c
    b = 2 * dot(f, d)
    discriminant = b * b - 4 * (dot(f, f) - r * r)
    root = jnp.sqrt(jnp.maximum(discriminant, 0))
    t0, t1 = (-b - root) / 2, (-b + root) / 2
    return jnp.where(discriminant < 0, FAR, jnp.where(t0 > 0, t0, jnp.where(t1 > 0, t1, FAR)))


def sign_zero_sphere(o, d, c, r):
    """Ray Tracing Gems ch. 7 with a sign that is 0 at 0."""
    f = o - c
    b = dot(f, d)
    away = f - b * d
    q = -b - jnp.sign(b) * jnp.sqrt(r * r - dot(away, away))
    return q, (dot(f, f) - r * r) / q


def moller_trumbore(o, d, corners, epsilon=0.0):
    """Möller and Trumbore (1997), with the usual absolute bound on the determinant."""
    e1, e2 = corners[1] - corners[0], corners[2] - corners[0]
    p, s = cross(d, e2), o - corners[0]
    det = dot(e1, p)
    u, q = dot(s, p) / det, cross(s, e1)
    v, t = dot(d, q) / det, dot(e2, q) / det
    return jnp.where((jnp.abs(det) > epsilon) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, FAR)
