"""jaxrt's half of the comparison of searches: prints one line of JSON.

python -m benchmarks.mesh_jaxrt rays SUBDIVISIONS RAYS.npz    the mesh and its rays, for both halves
python -m benchmarks.mesh_jaxrt time RAYS.npz                 Mrays per CPU second of each kind and search
python -m benchmarks.mesh_jaxrt crossover                     tree over loop, for few faces
python -m benchmarks.mesh_jaxrt large SUBDIVISIONS            build, draw, and the peak of memory
"""

import argparse
import json
import os
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.alternatives import moller_trumbore
from benchmarks.jaxrt_side import use_cores
from benchmarks.mesh_rays import (
    CLOSE,
    KINDS,
    LIGHT,
    OPEN,
    bumpy_sphere,
    camera_rays,
    in_the_open,
    incoherent_rays,
    room,
    unit,
)
from benchmarks.scans import scan, torus_knot

LANES = 128  # of a packet of `render`


def geometry(vertices: np.ndarray, faces: np.ndarray, tree: Any) -> Any:
    """Return the mesh as `render` reads it; tree: a topology, or None for a loop over all faces."""
    import jax
    import jax.numpy as jnp

    from jaxrt.shapes import Triangles, geometry_of

    triangles = Triangles(
        jnp.asarray(vertices, jnp.float32),
        jnp.asarray(faces, jnp.int32),
        jnp.zeros(len(faces), jnp.int32),
        tree,
    )
    return jax.jit(geometry_of)(None, triangles)


def searcher(any_hit: bool) -> Callable[..., Any]:
    """Return the compiled search of rays (n, 3): packets of 128 lanes in one native loop, as in `render`."""
    import jax
    import jax.numpy as jnp
    from jax import lax

    from jaxrt.core.records import Ray
    from jaxrt.kernels.native import map_packets
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
    """Save the mesh, and the rays of each kind; return how many there are, and what they take but for time."""
    from jaxrt.shapes import topology_of

    vertices, faces = bumpy_sphere(options.subdivisions)
    start_of_build = time.process_time()
    tree = topology_of(vertices, faces)
    build = time.process_time() - start_of_build
    assert tree is not None
    table, rays = geometry(vertices, faces, tree), {}
    for name, view in (("", 1.0), ("close_", CLOSE / len(faces) ** 0.5)):
        o, d = camera_rays(options.count, view)
        rays |= {f"{name}camera_o": o, f"{name}camera_d": d}
        rays |= {f"{name}shadow_{part}": value for part, value in shadow_rays(table, o, d).items()}
    rays["incoherent_o"], rays["incoherent_d"] = incoherent_rays(len(o))
    parts: dict[str, Any] = {
        f"tree_{name}": np.asarray(getattr(tree, name)) for name in ("children", "first", "last", "faces")
    }
    # The meshes of the open scenes go along: Mitsuba's half has nothing of the project's
    for name, (v, f) in zip(OPEN, (scan(), torus_knot()), strict=True):
        parts |= {f"{name}_vertices": v, f"{name}_faces": f}
    np.savez(options.file, vertices=vertices, faces=faces, tree_depth=tree.depth, **parts, **rays)
    visits = {kind: count_visits(table.triangles.tree, rays, *what) for kind, what in KINDS.items()}
    return {"rays": len(o), "build": build, "visits": visits}


def shadow_rays(table: Any, o: np.ndarray, d: np.ndarray) -> dict[str, np.ndarray]:
    """Return origins, directions and reaches of rays to a point light from what rays of a camera hit."""
    import jax
    import jax.numpy as jnp

    from jaxrt.core.records import Hit, Ray
    from jaxrt.shapes import leave, surface_point

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
    return {"o": start, "d": unit(away), "reach": np.linalg.norm(away, axis=1).astype(np.float32)}


def count_visits(tree: Any, rays: dict[str, np.ndarray], name: str, any_hit: bool) -> list[float]:
    """Return how many nodes and leaves a ray visits that walks alone, in the mean of every 31st ray."""
    import jax

    from benchmarks.alternatives.counted_walk import visits

    o, d = (rays[f"{name}_{part}"][::31] for part in "od")
    reach = rays.get(f"{name}_reach", np.full(len(rays[f"{name}_o"]), 1e30, np.float32))[::31]
    found = jax.jit(jax.vmap(lambda *ray: visits(any_hit, tree, *ray)[0]))(o, d, reach)
    return [float(x) for x in found.mean(0)]


def tree_in(file: Any) -> Any:
    """Return the topology that `write_rays` has saved."""
    import jax.numpy as jnp

    from jaxrt.shapes import Topology

    parts = [jnp.asarray(file[f"tree_{name}"]) for name in ("children", "first", "last", "faces")]
    return Topology(parts[0], parts[1], parts[2], parts[3], depth=int(file["tree_depth"]))


def run_time(options: argparse.Namespace) -> dict[str, Any]:
    """Return the median Mrays per CPU second of `repeat` calls, and the share that hits, of each kind and search."""
    import jax

    from jaxrt.shapes.search import walk

    if options.test == "moller-trumbore":
        walk.hit_distance = moller_trumbore.hit_distance
    file = np.load(options.file)
    table, report = geometry(file["vertices"], file["faces"], tree_in(file)), {}
    searches = {any_hit: searcher(any_hit) for any_hit in (False, True)}
    for name, (kind, any_hit) in KINDS.items():
        rays = [jax.device_put(file[f"{kind}_{part}"]) for part in "od"]
        reach = file[f"{kind}_reach"] if f"{kind}_reach" in file else np.full(len(rays[0]), 1e30, np.float32)
        found, seconds = clock(searches[any_hit], (table, *rays, reach), options.repeat)
        hits = np.asarray(found if any_hit else found.valid).mean()
        report[name] = [len(rays[0]) / 1e6 / seconds, float(hits)]
    if options.picture:
        report["picture"] = time_picture(room(file["vertices"], file["faces"]), 2)
        for name in OPEN:
            report[f"{name} in the open"] = time_picture(
                in_the_open(file[f"{name}_vertices"], file[f"{name}_faces"]), 2
            )
    return report


def clock(f: Callable[..., Any], arguments: tuple[Any, ...], repeat: int) -> tuple[Any, float]:
    """Return the result, and the median CPU seconds of calls after the first."""
    import jax

    seconds = []
    for _ in range(repeat + 1):
        start = time.process_time()
        result = jax.block_until_ready(f(*arguments))
        seconds.append(time.process_time() - start)
    return result, float(np.median(seconds[1:]))


def time_picture(description: dict[str, Any], repeat: int) -> list[float]:
    """Return [million camera paths per CPU second, mean radiance] of a scene."""
    import jaxrt

    scene = jaxrt.build(description)
    picture, seconds = clock(jaxrt.render, (scene, 0), repeat)
    return [scene.camera.width * scene.camera.height * scene.defaults.spp / 1e6 / seconds, float(picture.mean())]


def run_crossover(options: argparse.Namespace) -> dict[str, Any]:
    """Return how many times as fast as the loop the tree is, for meshes of few faces."""
    import jax

    from jaxrt.shapes import topology_of

    far = np.full(options.count, 1e30, np.float32)
    rays = {"camera": camera_rays(options.count), "incoherent": incoherent_rays(options.count)}
    report: dict[str, Any] = {}
    for n in (12, 24, 48, 96, 192):
        vertices, faces = bumpy_sphere(2)
        # Every so many of the sphere's faces, so that it stays a sphere with holes
        faces = faces[np.linspace(0, len(faces) - 1, n).astype(int)]
        trees = [topology_of(vertices, faces, least=1), None]
        tables = [geometry(vertices, faces, tree) for tree in trees]
        for kind, (o, d) in rays.items():
            search, ratios = searcher(False), []
            operands = [jax.device_put(x) for x in (o, d, far)]
            for _ in range(options.repeat):
                tree, loop = (clock(search, (table, *operands), 1)[1] for table in tables)
                ratios.append(loop / tree)
            report[f"{n} {kind}"] = float(np.median(ratios))
    return report


def run_large(options: argparse.Namespace) -> dict[str, Any]:
    """Return what a mesh of many faces takes: CPU seconds to build and to draw, and the peak of memory."""
    import jaxrt
    from jaxrt.shapes import topology_of

    vertices, faces = bumpy_sphere(options.subdivisions)
    start = time.process_time()
    topology_of(vertices, faces)
    build = time.process_time() - start
    scene = jaxrt.build(room(vertices, faces))
    picture, seconds = clock(jaxrt.render, (scene, 0), 1)
    kilobyte = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * kilobyte
    return {"faces": len(faces), "build": build, "draw": seconds, "mean": float(picture.mean()), "peak_bytes": peak}


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
    timing.add_argument("--picture", action="store_true", help="also a whole picture")
    timing.add_argument("--test", choices=["watertight", "moller-trumbore"], default="watertight")
    crossover = commands.add_parser("crossover")
    crossover.add_argument("--count", type=int, default=1 << 16)
    crossover.add_argument("--repeat", type=int, default=5)
    large = commands.add_parser("large")
    large.add_argument("subdivisions", type=int)
    options = parser.parse_args()
    use_cores(1)
    keep_programs()
    runs = {"rays": write_rays, "time": run_time, "crossover": run_crossover, "large": run_large}
    print(json.dumps(runs[options.command](options)))


def keep_programs() -> None:
    """Compile in the first round only, where the caller names a folder for caches."""
    import jax

    if "XDG_CACHE_HOME" in os.environ:
        jax.config.update("jax_compilation_cache_dir", os.environ["XDG_CACHE_HOME"] + "/jax")
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


if __name__ == "__main__":
    main()
