"""The forms of the ray–sphere quadratic that keep their digits, against the textbook's."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxrt
from benchmarks.alternatives import textbook_sphere
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.interleave import Swap, picture, swapped
from benchmarks.ladder import BASE, build
from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.shapes import sphere
from jaxrt.shapes.sphere import Spheres, SphereTable, find_sphere, lost_digits, sphere_surface_point, sphere_table
from tests.lanes import lanes
from tests.oracle import directions, dot, sphere_distances, unit_vectors

NAME, OURS, OTHER = "spheres", "two forms of each term", "textbook quadratic"
SWAPS: dict[str, list[Swap]] = {
    OURS: [],
    OTHER: [
        (sphere, "root_distance", textbook_sphere.distance),
        (sphere, "_distance_to_surface", textbook_sphere.distance_to_surface),
        (sphere, "onto_sphere", textbook_sphere.stay),
    ],
}
N = 100_000
FAR_BALLS, WALLS = (10, 1e3, 1e4), (1, 1e4, 1e6)
ROOM, BALL = "picture of the room", "picture of one ball"


def missed_at(distance: float) -> str:
    """Return the measure's name."""
    return f"wrong hits per 1e5, ball at {distance:g} radii"


def off_at(radius: float) -> str:
    """Return the measure's name."""
    return f"point off the wall, radius {radius:g}"


@jax.jit
@jax.vmap
def tables(center: Array, radius: Array, lost: Array) -> SphereTable:
    """Return a table of one sphere for each lane."""
    return sphere_table(Spheres(center[None], radius[None], lost[None], jnp.zeros(1, jnp.int32)))


def trace(swaps: list[Swap], center: np.ndarray, radius: float, o: np.ndarray, d: np.ndarray) -> tuple:
    """Return (row, position) of rays at one sphere, known to float64, as `build` knows it."""

    def one(table: SphereTable, o: Array, d: Array) -> tuple[Array, Array]:
        ray = Ray(o, d)
        return find_sphere(table, ray, jnp.full((), FAR))[1], sphere_surface_point(table, ray, jnp.int32(0)).position

    lost = lost_digits(center[None].astype(float), np.full(1, radius, float), np.float32)[0]
    rows = [np.broadcast_to(np.float32(x), (N, *np.shape(x))) for x in (center, radius, lost)]
    with swapped(swaps):
        return lanes(one)(tables(*rows), o, d)


def far_ball(variant: str, distance: float) -> Figure:
    """Return how often a ball of radius 1 is hit or missed wrongly from afar."""
    rng = np.random.default_rng(1)
    o = (distance * unit_vectors(rng, N)).astype(np.float32)
    aim = rng.uniform(-1.1, 1.1, (N, 3))
    aim -= o * (dot(aim, o) / dot(o.astype(float), o))[:, None]
    d, center = directions(o, aim), np.zeros(3, np.float32)
    row, _ = trace(SWAPS[variant], center, 1.0, o, d)
    hit = np.isfinite(sphere_distances(o, d, center, 1.0)[0])
    return error(NAME, variant, missed_at(distance), 1e5 * float(((row >= 0) != hit).mean()), ".0f")


def wall(variant: str, radius: float) -> Figure:
    """Return how far at most a point is from the sphere that it was found on, in a scene of size 2 beside it."""
    rng, axis = np.random.default_rng(6), np.array([0.6, 0.64, 0.48])
    center = (-axis * (radius if radius > 1 else 0)).astype(np.float32)
    o = (0.8 * unit_vectors(rng, N) + axis).astype(np.float32)
    d = directions(o, unit_vectors(rng, N) / 2)
    row, p = trace(SWAPS[variant], center, radius, o, d)
    near = (row >= 0) & (np.abs(p).max(1) < 2)
    off = np.abs(np.linalg.norm(p.astype(float) - center, axis=1) - radius)[near]
    return error(NAME, variant, off_at(radius), float(off.max()), ".1e")


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    figures = []
    for variant in SWAPS:
        figures += [far_ball(variant, x) for x in FAR_BALLS] + [wall(variant, x) for x in WALLS]
    size = {"width": 128, "height": 128}
    for name, scene in ((ROOM, jaxrt.load_scene("scenes/room.toml")), (BALL, build(BASE, **size))):
        pictures = {v: picture(scene, 4 if name == ROOM else 64, 4, swaps) for v, swaps in SWAPS.items()}
        figures += cost(NAME, name, {v: p.again for v, p in pictures.items()}, OURS, rounds)
    return figures


def argument(t: Table) -> str:
    """Return what the figures say."""
    far, huge = FAR_BALLS[-1], WALLS[-1]
    return (
        f"The textbook's quadratic takes {t(OTHER, ROOM):.2f} times our time in a room of six huge spheres and "
        f"{t(OTHER, BALL):.2f} times for one ball. For it, it finds or misses {t(OTHER, missed_at(far)):.0f} of "
        f"100,000 rays wrongly at a ball {far:g} radii away (ours: {t(OURS, missed_at(far)):.0f}), and puts points on "
        f"a wall of radius {huge:g} up to {t(OTHER, off_at(huge)):.1g} off in a scene of size 2 (ours: "
        f"{t(OURS, off_at(huge)):.1g}). Rooms are made of such walls, and a shadow ray that starts inside of one is "
        "black."
    )


CHOICE = Choice(
    NAME,
    "Ray and sphere: forms that keep their digits, or the textbook's",
    OURS,
    "100,000 rays each. Wrong hits: rays around the limb of a ball of radius 1, against long double. Off the wall: the "
    "greatest distance of a found point from the sphere, whose surface passes through a scene of size 2. Cost: the "
    "room, 256×256, 4 spp, and one ball under a point light, 128×128, 64 spp; max_depth 4.",
    measure,
    argument,
)
