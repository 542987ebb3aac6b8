"""Glass on which inside and outside are not told apart, or that nothing can shine through."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from jaxrt.description import SceneDescription, Solid
from jaxrt.description.mesh_facts import count_edges, signed_volume
from jaxrt.description.mesh_pairs import crosses_sphere, surfaces_cross
from jaxrt.description.values import Table
from jaxrt.scene.checks.common import Body, centers_and_radii, is_lit, spheres_of, transmits

REMEDY = "refraction is wrong where they do, move them apart or put one wholly inside the other"


def unsound_glass(bodies: Sequence[Body]) -> Iterator[str]:
    """Find glass meshes on which inside and outside are not told apart."""
    for body in bodies:
        if not body.has(transmits):
            continue
        edges, title = count_edges(body.vertices, body.faces), body.title
        if edges.open:
            yield f"{title}: is glass and not closed, {edges.open} edges have one face: refraction is wrong, close it"
        if edges.crowded:
            yield (
                f"{title}: is glass and {edges.crowded} edges have three faces or more: refraction may be wrong "
                "there, part the bodies"
            )
        if edges.flipped:
            yield (
                f"{title}: is glass and at {edges.flipped} edges two faces disagree on the outside: refraction is "
                "wrong, make the winding consistent"
            )
        elif not edges.open and signed_volume(body.vertices, body.faces) < 0:
            yield (
                f"{title}: is glass and its faces wind clockwise seen from outside, so that its inside is outside: "
                "refraction is wrong, reverse the faces"
            )


def point_light_and_glass(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[str]:
    """Find point lights in a scene with glass: neither a light sample nor a scattered ray joins the two."""
    points = [i for i, light in enumerate(scene.lights) if not light.radius]
    solids: list[Solid] = [*scene.spheres, *scene.triangles]
    glass = any(_is_clear(scene.materials[s.material]) for s in solids)
    if points and (glass or any(body.has(_is_clear) for body in bodies)):
        yield (
            f"lights[{points[0]}] is a point light and the scene has glass: no path can connect them, so "
            "glass casts a black shadow; use a radius > 0"
        )


def _is_clear(material: Table) -> bool:
    """Return whether light passes through in single directions, which no light sample has."""
    return transmits(material) and not is_lit(material)


def crossing_glass(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[str]:
    """Find glass things whose surfaces cross, the first pair. Nested ones are right: `ior` is inside over outside."""
    glass = spheres_of(scene, opaque=False)
    centers, radii = centers_and_radii([scene.spheres[i] for i in glass])
    for a in range(len(glass) - 1):
        distance = np.linalg.norm(centers[a + 1 :] - centers[a], axis=-1)
        cross = (np.abs(radii[a + 1 :] - radii[a]) <= distance) & (distance < radii[a + 1 :] + radii[a])
        if cross.any():
            b = a + 1 + int(np.argmax(cross))
            yield f"spheres[{glass[a]}] and spheres[{glass[b]}] are glass and overlap: {REMEDY}"
            return
    meshes = [body for body in bodies if body.has(transmits)]
    for body in meshes:
        corners = body.vertices[body.faces_of(transmits)]
        for i, center, radius in zip(glass, centers, radii, strict=True):
            if crosses_sphere(corners, center, radius):
                yield f"spheres[{i}] and {body.title} are glass and overlap: {REMEDY}"
                return
    for one, other in combinations(meshes, 2):
        boxes_meet = np.all((one.box[0] < other.box[1]) & (other.box[0] < one.box[1]))
        if boxes_meet and surfaces_cross(*((m.vertices, m.faces_of(transmits)) for m in (one, other))):
            yield f"{one.title} and {other.title} are glass and overlap: {REMEDY}"
            return
