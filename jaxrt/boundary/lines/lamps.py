"""Where mirrors and glass show light balls so small that looks at the corners of pixels may all miss them.

Such a picture is bright and ends abruptly: found late, by few samples, it makes these count a thousandfold. The ray
that leaves a chain passes a light at some distance, and this changes nearly linearly from pixel to pixel: three
neighbouring rays that miss a light tell whether one between them hits it.
"""

from typing import Any

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.lines.chains import ENDED, Chain
from jaxrt.core.maths import dot, safe_divide, safe_sqrt
from jaxrt.kernels.few import where_any
from jaxrt.transport.path import Tables

FEW = 32  # lights up to which they are looked for
AROUND = 0.5  # pixels beyond the three looks where they are looked for
BENT = 0.25  # of what a pixel changes, by which rays may pass elsewhere than their neighbours let expect


def shows_lamp(tables: Tables, chains: Chain) -> Array:
    """Return whether a light ball shows about three chains (3,): one pixel's, and those to the right and down of it."""
    lights = None if tables.lights is None else tables.lights.lights
    if lights is None or lights.radius is None or lights.radius.shape[0] > FEW:
        return jnp.zeros((), bool)

    def nowhere(_: Any, __: Chain) -> Array:
        return jnp.zeros((), bool)

    goes_on = jnp.all(chains.last > 0)
    found: Array = where_any(goes_on, _shows_any, nowhere, (lights.position, lights.radius), chains)
    return found


def _shows_any(lights: tuple[Array, Array], chains: Chain) -> Array:
    """Return whether one of the lights, places and radii, shows behind the first event of three chains."""
    position, radius = lights
    found, alike = jnp.zeros((), bool), jnp.ones((), bool)
    for k in range(1, chains.met.shape[1]):
        before, through = chains.met[:, k - 1], chains.through[:, k - 1]
        alike = (
            alike & jnp.all(before == before[0]) & jnp.all(through == through[0]) & jnp.all(chains.met[:, k] != ENDED)
        )
        origin, direction = chains.turns.ray.origin[:, k], chains.turns.ray.direction[:, k]

        def one(i: Array, found: Array, origin: Array = origin, direction: Array = direction) -> Array:
            return found | _hits_between(origin, direction, position[i], radius[i])

        found = found | (alike & lax.fori_loop(0, radius.shape[0], one, jnp.zeros((), bool)))
    return found


def _hits_between(origin: Array, direction: Array, center: Array, radius: Array) -> Array:
    """Return whether a ray between or beside three rays (3, 3) meets a ball, if it passes as these let expect."""
    away = center[None] - origin
    along = jnp.sum(away * direction, -1)
    here, right, down = away - along[:, None] * direction
    right, down = right - here, down - here
    # The least of |here + x right + y down|
    a, b, c = dot(right, right), dot(right, down), dot(down, down)
    p, q = -dot(here, right), -dot(here, down)
    area = a * c - b * b
    x, y = (jnp.clip(safe_divide(part, area), -AROUND, 1 + AROUND) for part in (c * p - b * q, a * q - b * p))
    least = here + x * right + y * down
    reach = radius + BENT * safe_sqrt(jnp.maximum(a, c))
    return jnp.all(along > 0) & (dot(least, least) < reach * reach)
