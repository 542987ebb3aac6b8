"""A scene's surfaces in float64 on the host: which cross, how far they are from touching, if they see one another."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxrt.description.box_tree import Floats, Ints, box_distances, box_tree, descend
from jaxrt.description.mesh_facts import count_edges, cross, faces_with_area, triangle_distances
from jaxrt.description.mesh_pairs import TOUCHING, faces_cross
from jaxrt.lights import casters_of
from jaxrt.scene import Scene, placed
from jaxrt.scene.lights import light_numbers
from jaxrt.scene.measures import moves_lamps
from jaxrt.scene.poses import moved_by
from jaxrt.shapes import kept_digits

Mask = NDArray[np.bool_]

AT_ONCE = 100_000  # balls against faces: what bounds the memory
LARGEST = 4_000_000  # faces times vertices of a mesh that is tested for convexity


class Surfaces(NamedTuple):
    """Spheres, then lights that have a place (points have radius 0), and triangles."""

    centers: Floats  # (n, 3)
    radii: Floats  # (n,)
    vertices: Floats  # (v, 3)
    faces: Ints  # (m, 3) those that have an area

    @property
    def corners(self) -> Floats:
        """Corners (m, 3, 3) of the faces."""
        return self.vertices[self.faces]


class Movers(NamedTuple):
    """Which surfaces change, as the camera sees them, with a parameter."""

    balls: Mask  # (n,)
    faces: Mask  # (m,)


def surfaces_of(scene: Scene) -> Surfaces:
    """Return the scene's surfaces; huge spheres lie where they are drawn, not where float32 rounds them to."""
    scene = placed(scene)
    centers, radii = [np.zeros((0, 3))], [np.zeros(0)]
    if (s := scene.spheres) is not None:
        centers.append(np.asarray(s.center, float))
        radii.append(np.asarray(s.radius, float) + np.asarray(kept_digits(s), float))
    if scene.lights is not None:
        places, sizes, _ = casters_of(scene.lights)
        centers.append(np.asarray(places, float))
        radii.append(np.zeros(len(places)) if sizes is None else np.asarray(sizes, float))
    vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    if scene.triangles is not None:
        vertices, faces = np.asarray(scene.triangles.vertices, float), np.asarray(scene.triangles.faces, np.int64)
        faces = faces[faces_with_area(vertices, faces)]
    return Surfaces(np.concatenate(centers), np.concatenate(radii), vertices, faces)


def movers_of(scene: Scene, surfaces: Surfaces, name: str, row: int | None) -> Movers:
    """Return what a parameter's row moves, or with None any of its rows; cameras and materials move all there is."""
    balls, faces = np.zeros(len(surfaces.radii), bool), np.zeros(len(surfaces.faces), bool)
    spheres = 0 if scene.spheres is None else len(scene.spheres.radius)
    rows = slice(None) if row is None else row
    if name.startswith(("camera.", "materials.")):
        balls[:], faces[:] = True, True
    elif name.startswith("spheres."):
        balls[:spheres][rows] = True
    elif moves_lamps(name):
        balls[spheres + light_numbers(scene, name)[rows]] = True
    elif name == "meshes.vertices":
        faces[:] = True if row is None else np.any(surfaces.faces == row, axis=1)
    elif scene.poses is not None:
        moved, vertices = moved_by(scene.poses, name, row, spheres, len(surfaces.vertices))
        balls[:spheres] = moved
        faces[:] = np.any(vertices[surfaces.faces], axis=1)
    return Movers(balls, faces)


def some_cross(surfaces: Surfaces, movers: Movers) -> bool:
    """Return whether a surface that moves cuts through any other; those that only touch do not."""
    every = Movers(np.ones_like(movers.balls), np.ones_like(movers.faces))
    if _balls_cross(surfaces, movers.balls, every.balls) or _cut_faces(surfaces, movers.balls, every.faces):
        return True
    if not movers.faces.any():
        return False
    moved, corners = surfaces.corners[movers.faces], surfaces.corners
    more = not movers.balls.all() and _cut_faces(surfaces, every.balls, movers.faces)
    return more or faces_cross(corners, corners if movers.faces.all() else moved)


def lamps_cross(scene: Scene, surfaces: Surfaces, movers: Movers) -> bool:
    """Return whether a light of some size cuts through any other surface, and one of the two moves."""
    lamps = np.arange(len(surfaces.radii)) >= (0 if scene.spheres is None else len(scene.spheres.radius))
    balls, faces = np.ones_like(movers.balls), np.ones_like(movers.faces)
    moved = movers.balls & lamps
    among_balls = _balls_cross(surfaces, moved, balls) or _balls_cross(surfaces, movers.balls, lamps)
    return among_balls or _cut_faces(surfaces, moved, faces) or _cut_faces(surfaces, lamps, movers.faces)


def _balls_cross(surfaces: Surfaces, some: Mask, others: Mask) -> bool:
    """Return whether one of some balls cuts one of others: they are neither apart nor one inside the other."""
    centers, radii = surfaces.centers, surfaces.radii
    distance = np.linalg.norm(centers[some][:, None] - centers[others], axis=-1)
    one, other = radii[some][:, None], radii[others]
    depth = np.minimum(one + other - distance, distance - np.abs(one - other))
    depth[np.flatnonzero(some)[:, None] == np.flatnonzero(others)] = -np.inf
    # The lesser ball tells the size: a wall may be a sphere of radius 1e6
    size = np.abs(centers).max(axis=-1, initial=0) + radii
    return bool(np.any(depth > TOUCHING * np.minimum(size[some][:, None], size[others])))


def _cut_faces(surfaces: Surfaces, balls: Mask, faces: Mask) -> bool:
    """Return whether one of the balls has places of a single face both inside and outside."""
    balls = balls & (surfaces.radii > 0)
    if not (balls.any() and faces.any()):
        return False
    centers, radii, corners = surfaces.centers[balls], surfaces.radii[balls], surfaces.corners[faces]
    margin = TOUCHING * np.minimum(np.abs(centers).max(axis=-1) + radii, np.abs(corners).max())

    def reaches(asked: Ints, low: Floats, high: Floats) -> Mask:
        center = centers[asked]
        farthest = np.linalg.norm(np.maximum(center - low, high - center), axis=-1)
        return (box_distances(center, low, high) < radii[asked]) & (farthest > radii[asked])

    ball, face = descend(box_tree(corners.min(axis=1), corners.max(axis=1)), reaches, np.arange(len(radii)))
    for start in range(0, len(ball), AT_ONCE):
        b, part = ball[start : start + AT_ONCE], corners[face[start : start + AT_ONCE]]
        outside = np.linalg.norm(part - centers[b, None], axis=-1).max(axis=-1) > radii[b] + margin[b]
        if np.any(outside & (triangle_distances(centers[b], part) < radii[b] - margin[b])):
            return True
    return False


def gaps(surfaces: Surfaces, center: Floats, radius: float, own: int | None = None) -> Floats:
    """Return how far ball `own`, or a point, is from where it would touch each sphere and the faces, (k,)."""
    solid = surfaces.radii > 0
    if own is not None:
        solid[own] = False
    radii, distance = surfaces.radii[solid], np.linalg.norm(surfaces.centers[solid] - center, axis=-1)
    found = [np.abs(distance - (radii + radius)), np.abs(distance - np.abs(radii - radius))]
    if len(surfaces.faces):
        found.append(np.abs(triangle_distances(center, surfaces.corners).min(keepdims=True) - radius))
    return np.concatenate(found)


def nothing_faces_another(surfaces: Surfaces, eye: Floats) -> bool:
    """Return whether no place that the camera sees has any other in view: one ball, a plane, or one convex solid."""
    balls, faces = int(np.sum(surfaces.radii > 0)), surfaces.faces
    if balls or not len(faces):
        return balls <= 1 and not len(faces)
    vertices = surfaces.vertices[np.unique(faces)]
    if len(faces) * len(vertices) > LARGEST:
        return False
    first, second, third = (surfaces.corners[:, i] for i in range(3))
    normals = cross(second - first, third - first)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    margin, offset = TOUCHING * np.abs(vertices).max(), np.sum(normals * first, axis=-1)
    heights, seen = normals @ vertices.T - offset[:, None], normals @ eye - offset
    if np.abs(heights).max() <= margin:
        return True
    above, below = heights.max(axis=-1) > margin, heights.min(axis=-1) < -margin
    outside = np.any(~above & (seen > 0) | ~below & (seen < 0))
    return bool(outside and not np.any(above & below) and not count_edges(surfaces.vertices, faces).open)
