"""Leaving a surface by its own rounding bound against leaving it by a fixed distance."""

import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxrt
from benchmarks.alternatives import fixed_epsilon
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.interleave import picture
from jaxrt.core.maths import FAR, dot
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.scene import drawn
from jaxrt.shapes import leave
from jaxrt.shapes.sphere import Spheres, find_sphere, sphere_surface_point, sphere_table
from jaxrt.shapes.triangle import corner_table, find_triangle, triangle_surface_point
from jaxrt.transport import path
from tests.lanes import lanes
from tests.oracle import directions, unit_vectors

NAME, OURS, OTHER = "offset", "rounding bound", "fixed 1e-4"
SCALES = (1e-3, 1.0, 1e3)
N = 100_000
GAP = 0.02  # from one plate to the other, in sizes of a plate
Leave = Callable[[SurfacePoint, Array], Ray]
METHODS: dict[str, Leave] = {OURS: leave, OTHER: fixed_epsilon.leave}


def scaled(description: dict[str, Any], s: float) -> dict[str, Any]:
    """Return a scene of balls, s times as large, that has the same picture."""

    def times(v: list[float]) -> list[float]:
        return [s * x for x in v]

    camera, spheres, lights = (description[name] for name in ("camera", "spheres", "lights"))
    view = {name: times(camera[name]) for name in ("position", "target")}
    balls = [ball | {"center": times(ball["center"]), "radius": s * ball["radius"]} for ball in spheres]
    size = {"position": lambda x: times(x), "intensity": lambda x: [s * s * v for v in x], "radius": lambda x: s * x}
    lamps = [light | {name: size[name](light[name]) for name in size} for light in lights]
    return description | {"camera": camera | view, "spheres": balls, "lights": lamps}


def ball_again(method: Leave, center: Array, radius: Array, o: Array, d: Array, w: Array) -> tuple[Array, Array]:
    """Return (hit?, hit again by the ray that leaves outwards?)."""
    table = sphere_table(Spheres(center[None], radius[None], jnp.zeros(1), jnp.zeros(1, jnp.int32)))
    far, ray = jnp.full((), FAR), Ray(o, d)
    point = sphere_surface_point(table, ray, jnp.int32(0))
    w = jnp.where(dot(point.normal, w) < 0, -w, w)
    return find_sphere(table, ray, far)[1] >= 0, find_sphere(table, method(point, w), far)[1] >= 0


def plate_row(method: Leave, corners: Array, o: Array, d: Array, w: Array) -> Array:
    """Return what a ray hits that leaves plate 0 towards plate 1; corners: (2, 3, 3)."""
    table = corner_table(corners, jnp.zeros(2, jnp.int32))
    point = triangle_surface_point(table, Ray(o, d), jnp.int32(0))
    return find_triangle(table, method(point, w), jnp.full((), FAR))[1]


def balls(s: float) -> tuple[np.ndarray, ...]:
    """Return balls of size s within 3 s of the origin, rays at them, and directions to leave by."""
    rng = np.random.default_rng(4)
    center = (s * rng.uniform(-3, 3, (N, 3))).astype(np.float32)
    radius = (s * rng.uniform(0.2, 1, N)).astype(np.float32)
    o = (center + 4 * s * unit_vectors(rng, N)).astype(np.float32)
    aim = center + 0.6 * radius[:, None] * unit_vectors(rng, N)
    return center, radius, o, directions(o, aim), unit_vectors(rng, N).astype(np.float32)


def plates(s: float) -> tuple[np.ndarray, ...]:
    """Return pairs of plates of size s, one over the other, rays at the lower ones, and directions up."""
    rng = np.random.default_rng(5)
    up = unit_vectors(rng, N)
    side = np.cross(up, unit_vectors(rng, N))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    across, middle = np.cross(up, side), rng.uniform(-3, 3, (N, 3))
    corners = np.stack([middle + a * side + b * across for a, b in ((-1, -1), (1, -1), (0, 1))], 1)
    above = middle[:, None] + 3 * (corners - middle[:, None]) + GAP * up[:, None]
    aim = middle + rng.uniform(-0.2, 0.2, (N, 1)) * side
    o = (s * (aim + up + 0.3 * unit_vectors(rng, N))).astype(np.float32)
    w = up + 0.6 * unit_vectors(rng, N)
    both = (s * np.stack([corners, above], 1)).astype(np.float32)
    return both, o, directions(o, s * aim), directions(np.zeros_like(o), w)


def faults(variant: str, s: float) -> list[Figure]:
    """Return acne and leaks of one variant at one scale."""
    hit, again = lanes(partial(ball_again, METHODS[variant]))(*balls(s))
    row = lanes(partial(plate_row, METHODS[variant]))(*plates(s))
    acne = 1e5 * (again[hit].mean() + (row == 0).mean()) / 2
    return [
        error(NAME, variant, acne_at(s), float(acne), ".0f"),
        error(NAME, variant, leaks_at(s), float(1e5 * (row < 0).mean()), ".0f"),
    ]


def acne_at(s: float) -> str:
    """Return the measure's name."""
    return f"acne per 1e5, scale {s:g}"


def leaks_at(s: float) -> str:
    """Return the measure's name."""
    return f"leaks per 1e5, scale {s:g}"


def wrong_at(s: float) -> str:
    """Return the measure's name."""
    return f"picture wrong by %, scale {s:g}"


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    room = tomllib.loads(Path("scenes/room.toml").read_text(encoding="utf-8"))
    room["camera"] |= {"width": 128, "height": 128}
    figures: list[Figure] = []
    pictures = {}
    for variant, method in METHODS.items():
        figures += [f for s in SCALES for f in faults(variant, s)]
        pictures[variant] = picture(jaxrt.build(room), 16, 4, [(path, "leave", method)])
    truth = np.asarray(pictures[OURS].draw())
    for variant, own in pictures.items():
        for s in SCALES:
            # Scenes of one structure share a program
            other = own._replace(scene=picture_scene(room, s, own.scene))
            off = np.abs(np.asarray(other.draw()) - truth).mean() / truth.mean()
            figures.append(error(NAME, variant, wrong_at(s), 100 * float(off), ".2g"))
    return figures + cost(NAME, "picture of the room", {v: p.again for v, p in pictures.items()}, OURS, rounds)


def picture_scene(room: dict[str, Any], s: float, like: jaxrt.Scene) -> jaxrt.Scene:
    """Return the scaled room with the static fields of a scene that was compiled."""
    from dataclasses import replace

    return replace(drawn(jaxrt.build(scaled(room, s))), defaults=like.defaults)


def argument(t: Table) -> str:
    """Return what the figures say."""
    small, _, large = SCALES
    return (
        f"A distance that suits scenes of size 1 fails at both ends. A thousand times larger, "
        f"{t(OTHER, acne_at(large)) / 1e3:.0f} % of rays meet again the surface that they leave, and the room's pixels "
        f"are off by {t(OTHER, wrong_at(large)):.2g} % of their mean; a thousand times smaller, "
        f"{t(OTHER, leaks_at(small)) / 1e3:.0f} % start beyond a plate that is {GAP:.0%} of the scene's size away, and "
        f"the room's pixels are off by {t(OTHER, wrong_at(small)):.2g} %. The rounding bound has "
        f"{t.span(OURS, 'error')[1]:.2g} at most in every column. The fixed distance takes "
        f"{t(OTHER, 'picture of the room'):.2f} times our time, and nobody tells its user which scenes it suits."
    )


CHOICE = Choice(
    NAME,
    "Leaving a surface: by its rounding bound, or by a fixed distance",
    OURS,
    "Acne: rays that leave a ball or a plate outwards and meet it again, 100,000 of each. Leaks: rays that leave a "
    "plate towards another 2 % of its size away and pass it. Picture: the room (scenes/room.toml) scaled as a whole, "
    "whose picture must not change: mean difference to ours at scale 1, with the same random numbers. Cost: 128×128, "
    "16 spp, max_depth 4.",
    measure,
    argument,
)
