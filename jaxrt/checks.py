"""What is legal in a scene, but hardly meant; and what does not fit into memory. NumPy, on the host."""

import os
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import (
    Diffuse,
    Glass,
    LightDescription,
    SceneDescription,
    SceneError,
    Solid,
    SphereDescription,
)

BYTES_PER_PIXEL = 72  # float32 sum, compensation, copy (36); float64 sum on the host (24); encoding (12)
TOO_NEAR = 1e-2  # of the distances around a point light: indirect light then has a relative error of dozens

Floats = NDArray[np.float64]


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
        *_point_light_and_glass(description),
        *_overlapping_glass(description),
        *_near_point_lights(description),
    ]


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


def _point_light_and_glass(scene: SceneDescription) -> Iterator[str]:
    """Find point lights in a scene with glass: neither a light sample nor a scattered ray joins the two."""
    points = [i for i, light in enumerate(scene.lights) if not light.radius]
    solids: list[Solid] = [*scene.spheres, *scene.triangles]
    if points and any(isinstance(scene.materials[s.material], Glass) for s in solids):
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
    """Return the distances (n,) from a light's centre to each diffuse sphere and triangle."""
    point = np.array(light.position)
    spheres = [s for s in scene.spheres if isinstance(scene.materials[s.material], Diffuse)]
    centers, radii = _centers_and_radii(spheres)
    to_spheres = np.abs(np.linalg.norm(centers - point, axis=-1) - radii)
    corners = [t.vertices for t in scene.triangles if isinstance(scene.materials[t.material], Diffuse)]
    return np.concatenate([to_spheres, _triangle_distances(point, np.array(corners).reshape(-1, 3, 3))])


def _triangle_distances(point: Floats, vertices: Floats) -> Floats:
    """Return the distances (n,) from a point (3,) to triangles (n, 3, 3)."""
    start, edge = vertices, np.roll(vertices, -1, axis=1) - vertices
    # Distance to each edge
    t = np.sum((point - start) * edge, axis=-1) / np.sum(edge * edge, axis=-1)
    to_edges = np.linalg.norm(start + np.clip(t, 0, 1)[..., None] * edge - point, axis=-1).min(axis=-1)
    # Distance to the plane, where the foot of the perpendicular is inside all three edges
    normal = np.cross(edge[:, 0], edge[:, 1])
    side = np.sum(np.cross(edge, point - start) * normal[:, None], axis=-1)
    to_plane = np.abs(np.sum((point - start[:, 0]) * normal, axis=-1)) / np.linalg.norm(normal, axis=-1)
    return np.where((side >= 0).all(axis=-1), to_plane, to_edges)


def _centers_and_radii(spheres: list[SphereDescription]) -> tuple[Floats, Floats]:
    """Return the centres (n, 3) and radii (n,) as arrays."""
    return np.array([s.center for s in spheres]).reshape(-1, 3), np.array([s.radius for s in spheres])


def _inside(point: tuple[float, float, float], centers: Floats, radii: Floats) -> NDArray[np.bool_]:
    """Return for each sphere (n,) whether it holds `point`."""
    return np.linalg.norm(centers - np.array(point), axis=-1) < radii
