"""jaxrt's half of the comparison of searches: prints one line of JSON.

python -m benchmarks.mesh_jaxrt rays SUBDIVISIONS RAYS.npz    the mesh and its rays, for both halves
python -m benchmarks.mesh_jaxrt time RAYS.npz                 Mrays per CPU second of each kind and search
"""

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.alternatives import moller_trumbore
from benchmarks.jaxrt_side import use_cores
from benchmarks.mesh_rays import LIGHT, bumpy_sphere, camera_rays, incoherent_rays, unit

LANES = 128  # of a packet of `render`


def geometry(vertices: np.ndarray, faces: np.ndarray) -> Any:
    """Return the mesh as `render` reads it."""
    import jax
    import jax.numpy as jnp

    from jaxrt.shapes import Triangles, geometry_of, topology_of

    triangles = Triangles(
        jnp.asarray(vertices, jnp.float32),
        jnp.asarray(faces, jnp.int32),
        jnp.zeros(len(faces), jnp.int32),
        topology_of(vertices, faces),
    )
    return jax.jit(geometry_of)(None, triangles)


def searcher(any_hit: bool) -> Callable[..., Any]:
    """Return the compiled search of rays (n, 3): packets of 128 lanes in one native loop, as in `render`."""
    import jax
    import jax.numpy as jnp
    from jax import lax

    from jaxrt.native import map_packets
    from jaxrt.records import Ray
    from jaxrt.shapes import find, occluded

    @jax.jit
    def search(geometry: Any, o: Any, d: Any, reach: Any) -> Any:
        def packet(operands: Any, k: Any) -> Any:
            geometry, *rays = operands
            rows = [lax.dynamic_slice_in_dim(x, k * LANES, LANES) for x in rays]
            if any_hit:
                return jax.vmap(lambda o, d, reach: occluded(geometry, Ray(o, d), reach))(*rows)
            return jax.vmap(lambda o, d, _: find(geometry, Ray(o, d)))(*rows)

        return map_packets(packet, (geometry, o, d, reach), jnp.arange(reach.shape[0] // LANES, dtype=jnp.int32))

    return search


def write_rays(options: argparse.Namespace) -> dict[str, Any]:
    """Save the mesh, and the rays of each kind; the shadow rays go from what the camera sees to a point light."""
    import jax
    import jax.numpy as jnp

    from jaxrt.records import Hit, Ray
    from jaxrt.shapes import leave, surface_point

    vertices, faces = bumpy_sphere(options.subdivisions)
    o, d = camera_rays(options.count)
    table = geometry(vertices, faces)
    hit = searcher(False)(table, o, d, np.ones(len(o), np.float32))
    index, valid = (np.asarray(x).ravel() for x in (hit.index, hit.valid))

    @jax.jit
    @jax.vmap
    def to_light(o: Any, d: Any, index: Any) -> Any:
        point = surface_point(table, Ray(o, d), Hit(index, jnp.bool_(True)))
        away = jnp.asarray(LIGHT) - point.position
        return leave(point, away).origin

    start = np.asarray(to_light(o, d, index))[valid]
    # As many as of the other kinds, so that they share a program: the first ones again
    start = np.resize(start, o.shape)
    away = np.asarray(LIGHT) - start
    io, id_ = incoherent_rays(len(o))
    rays = {"camera_o": o, "camera_d": d, "incoherent_o": io, "incoherent_d": id_}
    rays |= {"shadow_o": start, "shadow_d": unit(away), "shadow_reach": np.linalg.norm(away, axis=1).astype(np.float32)}
    np.savez(options.file, vertices=vertices, faces=faces, **rays)
    return {"rays": len(o)}


def run_time(options: argparse.Namespace) -> dict[str, Any]:
    """Return the median Mrays per CPU second of `repeat` calls, and the share that hits, of each kind and search."""
    import jax

    from jaxrt.shapes import traverse

    if options.test == "moller-trumbore":
        traverse.hit_distance = moller_trumbore.hit_distance
    file = np.load(options.file)
    table, report = geometry(file["vertices"], file["faces"]), {}
    searches = {any_hit: searcher(any_hit) for any_hit in (False, True)}
    for name, any_hit in (("camera", False), ("shadow", True), ("incoherent", False), ("incoherent any", True)):
        kind = name.split()[0]
        rays = [jax.device_put(file[f"{kind}_{part}"]) for part in "od"]
        reach = file["shadow_reach"] if kind == "shadow" else np.full(len(rays[0]), 1e30, np.float32)
        search, seconds = searches[any_hit], []
        found = jax.block_until_ready(search(table, *rays, reach))
        for _ in range(options.repeat):
            start = time.process_time()
            jax.block_until_ready(search(table, *rays, reach))
            seconds.append(time.process_time() - start)
        hits = np.asarray(found if any_hit else found.valid).mean()
        report[name] = [len(rays[0]) / 1e6 / float(np.median(seconds)), float(hits)]
    return report


def main() -> None:
    """Run one command and print its JSON."""
    parser = argparse.ArgumentParser(description="Measure the searches of a mesh.")
    commands = parser.add_subparsers(dest="command", required=True)
    rays = commands.add_parser("rays")
    rays.add_argument("subdivisions", type=int)
    rays.add_argument("file")
    rays.add_argument("--count", type=int, default=1 << 18)
    timing = commands.add_parser("time")
    timing.add_argument("file")
    timing.add_argument("--repeat", type=int, default=7)
    timing.add_argument("--test", choices=["watertight", "moller-trumbore"], default="watertight")
    options = parser.parse_args()
    use_cores(1)
    print(json.dumps({"rays": write_rays, "time": run_time}[options.command](options)))


if __name__ == "__main__":
    main()
