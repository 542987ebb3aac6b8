"""What is legal in a scene, but hardly meant; and what does not fit into memory. NumPy, on the host."""

import os
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import (
    Diffuse,
    Glass,
    LightDescription,
    MeshDescription,
    SceneDescription,
    SceneError,
    Solid,
    SphereDescription,
)
from jaxrt.mesh_facts import Floats, count_edges, distance_range, signed_volume, triangle_distances, winding_number

BYTES_PER_PIXEL = 72  # float32 sum, compensation, copy (36); float64 sum on the host (24); encoding (12)
TOO_NEAR = 1e-2  # of the distances around a point light: indirect light then has a relative error of dozens


def check_memory(width: int, height: int, source: str = "scene") -> None:
    """Raise SceneError where a picture of width × height pixels cannot fit into this machine's memory."""
    needed = width * height * BYTES_PER_PIXEL
    present = _physical_memory()
    if present is not None and needed > present:
        raise SceneError(
            f"{source}: camera: image {width}x{height} needs {needed / 2**30:.1f} GiB, this machine has "
            f"{present / 2**30:.1f} GiB: lower width or height"
        )


def _physical_memory() -> int | None:
    """Return the bytes of memory of this machine, None where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def warnings_of(description: SceneDescription) -> list[str]:
    """Return one line for each thing in the scene that is legal but hardly meant."""
    return [
        *_dark(description),
        *_walled_in(description),
        *_walled_in_meshes(description),
        *_left_out(description),
        *_dropped_faces(description),
        *_unsound_glass(description),
        *_point_light_and_glass(description),
        *_overlapping_glass(description),
        *_near_point_lights(description),
    ]


def _left_out(scene: SceneDescription) -> Iterator[str]:
    """Tell what mesh files hold that is not read, and what was mended."""
    for i, mesh in enumerate(scene.meshes):
        if mesh.notes:
            yield f"meshes[{i}] ({mesh.file}): {mesh.notes}"


def _dark(scene: SceneDescription) -> Iterator[str]:
    """Find a scene without light."""
    sky = scene.environment
    if not scene.lights and sky is None:
        yield "no light and no environment: the picture is black, add [[lights]] or [environment]"
    elif not any(any(light.intensity) for light in scene.lights) and not (sky and any(sky.radiance)):
        yield "no light or environment has any power: the picture is black, raise an intensity or radiance"


def _walled_in(scene: SceneDescription) -> Iterator[str]:
    """Find lights that closed opaque spheres or other lights part from the camera."""
    opaque = [i for i, s in enumerate(scene.spheres) if not isinstance(scene.materials[s.material], Glass)]
    walls = [scene.spheres[i] for i in opaque]
    centers, radii = _centers_and_radii(walls)
    camera_inside = _inside(scene.camera.position, centers, radii)
    for i, light in enumerate(scene.lights):
        parted = _inside(light.position, centers, radii) != camera_inside
        if parted.any():
            wall = int(np.argmax(parted))
            light_is, camera_is = ("outside", "inside") if camera_inside[wall] else ("inside", "outside")
            yield (
                f"lights[{i}] is {light_is} of spheres[{opaque[wall]}] ({walls[wall].material}) and the "
                f"camera {camera_is}: its light cannot be seen, move one of them"
            )
        if light.radius and np.linalg.norm(np.subtract(scene.camera.position, light.position)) < light.radius:
            yield f"the camera is inside of lights[{i}]: the picture is black, move one of them"
    if not scene.lights and scene.environment and camera_inside.any():
        wall = opaque[int(np.argmax(camera_inside))]
        yield f"the camera is inside of spheres[{wall}] without lights: the picture is black, move it"


def _walled_in_meshes(scene: SceneDescription) -> Iterator[str]:
    """Find lights that closed opaque meshes part from the camera."""
    for m, mesh in enumerate(scene.meshes):
        if _has(scene, mesh, Glass):
            continue
        places = [scene.camera.position, *(light.position for light in scene.lights)]
        camera_inside, *lights_inside = (_inside_mesh(place, mesh) for place in places)
        for i, inside in enumerate(lights_inside):
            if inside != camera_inside:
                light_is, camera_is = ("inside", "outside") if inside else ("outside", "inside")
                yield (
                    f"lights[{i}] is {light_is} of meshes[{m}] ({mesh.names[0]}) and the camera {camera_is}: its "
                    "light cannot be seen, move one of them"
                )
        if not scene.lights and scene.environment and camera_inside:
            yield f"the camera is inside of meshes[{m}] without lights: the picture is black, move it"


def _inside_mesh(place: tuple[float, float, float], mesh: MeshDescription) -> bool:
    """Return whether a mesh that is closed holds a place; its box answers first, since it costs least."""
    point, faces = np.array(place), mesh.faces[mesh.kept]
    if not ((mesh.world.min(axis=0) < point) & (point < mesh.world.max(axis=0))).all():
        return False
    return winding_number(point, mesh.world, faces) != 0 and not count_edges(mesh.world, faces).open


def _dropped_faces(scene: SceneDescription) -> Iterator[str]:
    """Find faces that no ray can hit."""
    for m, mesh in enumerate(scene.meshes):
        dropped = len(mesh.faces) - len(mesh.kept)
        if dropped:
            first = int(np.argmax(~np.isin(np.arange(len(mesh.faces)), mesh.kept)))
            yield f"{_title(m, mesh)}: {dropped} of {len(mesh.faces)} faces have no area and are dropped, first {first}"


def _unsound_glass(scene: SceneDescription) -> Iterator[str]:
    """Find glass meshes on which inside and outside are not told apart."""
    for m, mesh in enumerate(scene.meshes):
        if not _has(scene, mesh, Glass):
            continue
        faces, title = mesh.faces[mesh.kept], _title(m, mesh)
        edges = count_edges(mesh.world, faces)
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
        elif not edges.open and signed_volume(mesh.world, faces) < 0:
            yield (
                f"{title}: is glass and its faces wind clockwise seen from outside, so that its inside is outside: "
                "refraction is wrong, reverse the faces"
            )


def _title(m: int, mesh: MeshDescription) -> str:
    return f"meshes[{m}]" + (f" ({mesh.file})" if mesh.file else "")


def _has(scene: SceneDescription, mesh: MeshDescription, kind: type) -> bool:
    """Return whether any material of the mesh is of this kind."""
    return any(isinstance(scene.materials[name], kind) for name in mesh.names)


def _point_light_and_glass(scene: SceneDescription) -> Iterator[str]:
    """Find point lights in a scene with glass: neither a light sample nor a scattered ray joins the two."""
    points = [i for i, light in enumerate(scene.lights) if not light.radius]
    solids: list[Solid] = [*scene.spheres, *scene.triangles]
    glass = any(isinstance(scene.materials[s.material], Glass) for s in solids)
    if points and (glass or any(_has(scene, mesh, Glass) for mesh in scene.meshes)):
        yield (
            f"lights[{points[0]}] is a point light and the scene has glass: no path can connect them, so "
            "glass casts a black shadow; use a radius > 0"
        )


def _overlapping_glass(scene: SceneDescription) -> Iterator[str]:
    """Find glass spheres whose surfaces cross. Nested ones are right, since `ior` is inside over outside."""
    glass = [i for i, s in enumerate(scene.spheres) if isinstance(scene.materials[s.material], Glass)]
    centers, radii = _centers_and_radii([scene.spheres[i] for i in glass])
    for a in range(len(glass) - 1):
        distance = np.linalg.norm(centers[a + 1 :] - centers[a], axis=-1)
        cross = (np.abs(radii[a + 1 :] - radii[a]) <= distance) & (distance < radii[a + 1 :] + radii[a])
        if cross.any():
            b = a + 1 + int(np.argmax(cross))
            yield (
                f"spheres[{glass[a]}] and spheres[{glass[b]}] are glass and overlap: refraction is wrong "
                "where they do, move them apart or put one wholly inside the other"
            )
            return


def _near_point_lights(scene: SceneDescription) -> Iterator[str]:
    """Find point lights so near to a diffuse surface that indirect light from there is mostly noise."""
    for i, light in enumerate(scene.lights):
        if light.radius:
            continue
        distances = _surface_distances(scene, light)
        to_camera = float(np.linalg.norm(np.subtract(scene.camera.position, light.position)))
        if distances.size and distances.min() < TOO_NEAR * max(to_camera, distances.max()):
            yield (
                f"lights[{i}] is a point light at {distances.min():.2g} from a surface: indirect light from "
                "there is very noisy; move it away or use a radius > 0"
            )


def _surface_distances(scene: SceneDescription, light: LightDescription) -> Floats:
    """Return the distances from a light's centre to each diffuse sphere and triangle, two for each diffuse mesh."""
    point = np.array(light.position)
    spheres = [s for s in scene.spheres if isinstance(scene.materials[s.material], Diffuse)]
    centers, radii = _centers_and_radii(spheres)
    to_spheres = np.abs(np.linalg.norm(centers - point, axis=-1) - radii)
    corners = [t.vertices for t in scene.triangles if isinstance(scene.materials[t.material], Diffuse)]
    to_triangles = triangle_distances(point, np.array(corners).reshape(-1, 3, 3))
    meshes = [m for m in scene.meshes if _has(scene, m, Diffuse)]
    to_meshes = [d for m in meshes for d in distance_range(point, m.world, m.faces[m.kept])]
    return np.concatenate([to_spheres, to_triangles, to_meshes])


def _centers_and_radii(spheres: list[SphereDescription]) -> tuple[Floats, Floats]:
    """Return the centres (n, 3) and radii (n,) as arrays."""
    return np.array([s.center for s in spheres]).reshape(-1, 3), np.array([s.radius for s in spheres])


def _inside(point: tuple[float, float, float], centers: Floats, radii: Floats) -> NDArray[np.bool_]:
    """Return for each sphere (n,) whether it holds `point`."""
    return np.linalg.norm(centers - np.array(point), axis=-1) < radii
