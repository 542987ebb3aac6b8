"""The outlines that things show to an eye, be it a light or the camera: circles on spheres, edges of meshes.

Everything here is without derivative. An outline is cut into rows (a sphere, or an edge), each of a parameter t in
[0, 1) that runs along it.
"""

from functools import partial

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import cross, dot, normalize, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.pytree import pytree, where
from jaxrt.core.sampling import frame, sincos_2pi
from jaxrt.kernels.native import once
from jaxrt.shapes import Triangles
from jaxrt.shapes.sphere import SphereTable


@pytree
class EdgeTable:
    """Edges as the sampler reads them."""

    corners: Array  # (e, 4, 3) both ends, then the third corners of both faces
    normals: Array  # (e, 2, 3) unit normals of both faces, on the same side of the surface; 0 for a face of no area
    vertices: Array  # (e, 2) int32
    faces: Array  # (e, 2) int32
    used: Array  # (e,) bool
    border: Array  # (e,) bool: of one face
    same: Array  # (e,) bool: both faces have one material


@pytree
class Silhouettes:
    """All that can have an outline: spheres, then sphere lights, then edges. What is absent is None."""

    spheres: SphereTable | None
    edges: EdgeTable | None

    @property
    def spheres_count(self) -> int:
        """Number of rows that are spheres or sphere lights."""
        return 0 if self.spheres is None else self.spheres.radius.shape[0]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.spheres_count + (0 if self.edges is None else self.edges.used.shape[0])


@pytree
class Afar:
    """An eye that is so far away that all its lines of sight are parallel."""

    direction: Array  # (3,) unit, in which it looks
    extent: Array  # () diagonal of what it sees, in scene units


Eye = Array | Afar  # (3,)
FEW_ROWS = 512  # outlines up to this number are cut into BINS bins each
BINS = 8
NARROWEST = 1e-3  # share of an outline within which most of it is wanted, at least


@pytree
class Rim:
    """A point of an outline as an eye sees it."""

    point: Array  # (3,)
    normal: Array  # (3,) unit, at right angles to the line of sight and to the outline, away from what blocks
    jacobian: Array  # () length of outline at right angles to the line of sight, per unit of t
    distance: Array  # () from the eye; 1 from one that is far away
    valid: Array  # () bool: there is an outline here


def _normals(corners: Array) -> Array:
    """Return unit normals (n, 3) of corners (n, 3, 3); 0 for a triangle that has no area to rounding."""
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = cross(edge1.T, edge2.T).T
    largest = jnp.max(jnp.abs(normal), -1)
    rounding = 4 * unit_roundoff(edge1) * jnp.max(jnp.abs(edge1), -1) * jnp.max(jnp.abs(edge2), -1)
    scaled = normal / jnp.where(largest > rounding, largest, 1)[:, None]
    length = jnp.sqrt(jnp.sum(scaled * scaled, -1))
    return jnp.where((largest > rounding)[:, None], scaled / jnp.where(length > 0, length, 1)[:, None], 0)


def edge_table(triangles: Triangles) -> EdgeTable:
    """Return the rows that the sampler reads, from the vertices as they stand."""
    edges = triangles.edges
    assert edges is not None
    corners = triangles.vertices[jnp.concatenate([edges.vertices, edges.opposite], -1)]
    a, b, v0, v1 = (corners[:, i] for i in range(4))
    border = edges.faces[:, 0] == edges.faces[:, 1]
    # Wound so that both normals lie on one side of the surface
    first, second = _normals(jnp.stack([a, b, v0], 1)), _normals(jnp.stack([b, a, v1], 1))
    second = jnp.where(border[:, None], -second, second)
    material = triangles.material[edges.faces]
    same = (material[:, 0] == material[:, 1]) & ~_are_seams(triangles)
    return EdgeTable(corners, jnp.stack([first, second], 1), edges.vertices, edges.faces, edges.used, border, same)


def _are_seams(triangles: Triangles) -> Array:
    """Return whether at each edge (e,) places on textures jump from one face to the other."""
    edges, chart = triangles.edges, triangles.chart
    assert edges is not None
    jumps = jnp.zeros(edges.faces.shape[0], bool)
    if chart is None:
        return jumps
    # The corners of both faces that come after the one off the edge
    faces = triangles.faces[edges.faces]
    tip = jnp.argmax(faces == edges.opposite[..., None], -1)
    ends = (tip[..., None] + jnp.arange(1, 3)) % 3
    places = triangles.vertices[jnp.take_along_axis(faces, ends, -1)]
    crossed = jnp.any(places[:, 0, 0] != places[:, 1, 0], -1)
    for values in (chart.uv, None if chart.vertices is None else chart.vertices[..., None]):
        if values is not None:
            own = jnp.take_along_axis(values[edges.faces], ends[..., None], 2)
            other = jnp.where(crossed[:, None, None], own[:, 1, ::-1], own[:, 1])
            jumps = jumps | jnp.any(own[:, 0] != other, (-2, -1))
    return jumps


def bins_for(rows: int) -> int:
    """Return into how many bins to cut each of so many outlines."""
    return BINS if rows <= FEW_ROWS else 1


def angular_lengths(table: Silhouettes, eye: Eye, reach: Array, creases: bool, bins: int) -> Array:
    """Return the angle (rows · bins,) that each row's bins span, seen from an eye; 0 where they show no outline.

    reach: () the eye may be anywhere within this distance. creases: count every edge across which the surface's colour
    can change, not silhouettes alone. An eye that is far away sees lengths, up to about its extent.
    """
    parts = []
    if table.spheres is not None and isinstance(eye, Afar):
        parts.append(jnp.repeat(2 * jnp.pi * jnp.minimum(table.spheres.radius, eye.extent) / bins, bins))
    elif table.spheres is not None:
        assert not isinstance(eye, Afar)
        squared, power = _seen_sphere(table.spheres, eye)
        sine = jnp.minimum(table.spheres.radius * lax.rsqrt(jnp.where(squared > 0, squared, 1)), 1)
        distance, radius = jnp.sqrt(squared), table.spheres.radius
        length = jnp.where((power > 0) | (distance + reach > radius), 2 * jnp.pi * sine, 0)
        parts.append(jnp.repeat(length / bins, bins))
    if table.edges is not None:
        parts.append(_angular_edges(table.edges, eye, reach, creases, bins))
    return jnp.concatenate(parts)


def _angular_edges(edges: EdgeTable, eye: Eye, reach: Array, creases: bool, bins: int) -> Array:
    """Return the angle (e · bins,) of each edge's bins."""
    a, b = edges.corners[:, None, 0], edges.corners[:, None, 1]
    t = ((jnp.arange(bins, dtype=reach.dtype) + 0.5) / bins)[None, :, None]
    points = a + t * (b - a)
    # As far as a length away, it looks as large as that
    away = jnp.broadcast_to(eye.direction, points.shape) if isinstance(eye, Afar) else points - eye[None, None]
    squared = jnp.sum(away * away, -1) + reach * reach
    side = jnp.stack(jnp.broadcast_arrays(*_cross_rows(b - a, away)), -1)
    length = safe_divide(jnp.sqrt(jnp.sum(side * side, -1)), squared) / bins
    length = jnp.minimum(length, eye.extent / bins) if isinstance(eye, Afar) else length
    n0, n1 = edges.normals[:, 0], edges.normals[:, 1]
    bent = is_bent(edges)
    if creases:
        shown = bent | ~edges.same
    else:
        assert not isinstance(eye, Afar)
        h0, h1 = (jnp.sum(n * (eye[None] - edges.corners[:, 0]), -1) for n in (n0, n1))
        shown = bent & (edges.border | ~(((h0 > reach) & (h1 > reach)) | ((h0 < -reach) & (h1 < -reach))))
    return jnp.where((shown & edges.used)[:, None], length, 0).ravel()


def is_bent(edges: EdgeTable) -> Array:
    """Return whether each edge (e,) can be an outline: it ends a surface, or its faces are not of one plane."""
    turn = jnp.sqrt(jnp.sum((edges.normals[:, 0] - edges.normals[:, 1]) ** 2, -1))
    return edges.border | (turn > 1e-4)


def _cross_rows(a: Array, b: Array) -> tuple[Array, Array, Array]:
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return y * w - z * v, z * u - x * w, x * v - y * u


def _seen_sphere(table: SphereTable, eye: Array) -> tuple[Array, Array]:
    """Return |c − eye|² and that less r², (n,) each, the latter without cancellation for huge spheres."""
    away = eye[None] - table.center
    power = jnp.sum((eye[None] - table.base) * (away - table.shift), -1) + table.constant
    return jnp.sum(away * away, -1), power


def rim_at(table: Silhouettes, row: Array, t: Array, eye: Eye, creases: bool) -> Rim:
    """Return the point at t of a row's outline, as seen from an eye. creases: see `angular_lengths`."""
    if table.edges is None:
        assert table.spheres is not None
        return _sphere_rim(table.spheres, row, t, eye)
    if table.spheres is None:
        return _edge_rim(table.edges, row, t, eye, creases)
    n = table.spheres_count
    a = once(_sphere_rim)(table.spheres, jnp.minimum(row, n - 1), t, eye)
    b = once(partial(_edge_rim, creases=creases))(table.edges, jnp.maximum(row - n, 0), t, eye)
    chosen: Rim = where(row < n, a, b)
    return chosen


@pytree
class Aim:
    """Where on an outline most is wanted, and within which share of it: a distribution after Cauchy."""

    t: Array  # ()
    width: Array  # ()
    round: Array  # () bool: the outline is a circle

    def draw(self, u: Array) -> Array:
        """Return a place from a number in [0, 1)."""
        turn = jnp.arctan(jnp.tanh(jnp.pi * self.width) * jnp.tan(jnp.pi * (u - 0.5))) / jnp.pi
        around = self.t + turn
        low, high = self._share_before(jnp.zeros_like(u)), self._share_before(jnp.ones_like(u))
        along = self.t + self.width * jnp.tan(jnp.pi * (low + u * (high - low) - 0.5))
        return jnp.where(self.round, around - jnp.floor(around), jnp.clip(along, 0, 1))

    def density(self, t: Array) -> Array:
        """Return that of a place."""
        spread = 2 * jnp.pi * self.width
        half, turn = jnp.sinh(spread / 2), jnp.sin(jnp.pi * (t - self.t))
        around = jnp.sinh(spread) / (2 * (half * half + turn * turn))
        off = (t - self.t) / self.width
        whole = self._share_before(jnp.ones_like(t)) - self._share_before(jnp.zeros_like(t))
        return jnp.where(self.round, around, 1 / (jnp.pi * self.width * (1 + off * off) * whole))

    def _share_before(self, t: Array) -> Array:
        return jnp.arctan((t - self.t) / self.width) / jnp.pi + 0.5


def aim_at(table: Silhouettes, row: Array, eye: Array, direction: Array, angle: Array) -> Aim:
    """Return where a row's outline comes nearest to a line from an eye, as wide as an angle looks there."""
    places, n = [], table.spheres_count
    if table.spheres is not None:
        side, up = frame(normalize(table.spheres.center[jnp.minimum(row, n - 1)] - eye))
        turn = jnp.arctan2(dot(direction, up), dot(direction, side)) / (2 * jnp.pi)
        places.append(turn - jnp.floor(turn))
    if table.edges is not None:
        corners = table.edges.corners[jnp.maximum(row - n, 0)]
        start, along = (v - dot(v, direction) * direction for v in (corners[0] - eye, corners[1] - corners[0]))
        places.append(jnp.clip(safe_divide(-dot(start, along), dot(along, along)), 0, 1))
    t = places[0] if len(places) == 1 else jnp.where(row < n, places[0], places[1])
    rim = rim_at(table, row, t, eye, True)
    away = normalize(rim.point - eye) - direction
    width = safe_divide(safe_sqrt(angle * angle + dot(away, away)) * rim.distance, rim.jacobian)
    return Aim(t, jnp.clip(width, NARROWEST, 1), row < n)


def _sphere_rim(table: SphereTable, row: Array, t: Array, eye: Eye) -> Rim:
    """Return a point of the circle where lines from the eye touch a sphere."""
    center, radius = table.center[row], table.radius[row]
    cos, sin = once(sincos_2pi)(t)
    if isinstance(eye, Afar):
        side, up = frame(eye.direction)
        normal, one = cos * side + sin * up, jnp.ones_like(radius)
        return Rim(center + radius * normal, normal, 2 * jnp.pi * radius, one, one > 0)
    away = eye - center
    squared = dot(away, away)
    power = dot(eye - table.base[row], away - table.shift[row]) + table.constant[row]
    valid = (power > 0) & (squared > 0)
    inverse = lax.rsqrt(jnp.where(valid, squared, 1))
    sine, cosine = radius * inverse, safe_sqrt(power) * inverse
    axis = jnp.where(valid, -away * inverse, jnp.zeros_like(away).at[2].set(1))
    normal = once(_tilted)(axis, (cos, sin), (cosine, sine))
    return Rim(center + radius * normal, normal, 2 * jnp.pi * radius * cosine, safe_sqrt(power), valid & (power > 0))


def _tilted(axis: Array, turn: tuple[Array, Array], lean: tuple[Array, Array]) -> Array:
    """Return a direction that leans back from an axis, at a turn about it: cosine and sine of both."""
    side, up = frame(axis)
    return lean[0] * (turn[0] * side + turn[1] * up) - lean[1] * axis


def _edge_rim(table: EdgeTable, row: Array, t: Array, eye: Eye, creases: bool) -> Rim:
    """Return a point of an edge."""
    a, b, v0, v1 = (table.corners[row, i] for i in range(4))
    point = a + t * (b - a)
    away = eye.direction if isinstance(eye, Afar) else point - eye
    distance = safe_sqrt(dot(away, away))
    side = cross(b - a, normalize(away))
    jacobian = safe_sqrt(dot(side, side))
    normal = normalize(side)
    first, second = dot(normal, v0 - a), dot(normal, v1 - a)
    normal = jnp.where(first > 0, -normal, normal)
    shown = (jacobian > 0) & (distance > 0)
    return Rim(point, normal, jacobian, distance, shown if creases else shown & (first * second > 0))
