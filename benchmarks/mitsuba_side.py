"""The peer's half of the comparison: render a jaxrt scene file with Mitsuba 3.

Runs in Mitsuba's own environment as a plain script, so it imports nothing of jaxrt:

    python benchmarks/mitsuba_side.py time  SCENE --repeat N                 seconds of first and later calls
    python benchmarks/mitsuba_side.py image SCENE --out STACK.npz --seeds N  one image per seed
    python benchmarks/mitsuba_side.py cold  SCENE --out PICTURE.png          one render, start to file

Each prints one line of JSON. What is shown is what jaxrt shows: two-sided surfaces, sphere lights that are
visible black bodies of radiance intensity / (π r²), no roulette, box filter.
"""

import argparse
import json
import math
import os
import resource
import statistics
import sys
import time
import tomllib
from pathlib import Path

import numpy as np

SMOOTHEST = 0.05  # roughness of jaxrt's facets; a plastic of that has a smooth coat here
NO_ROULETTE = 1_000_000  # depth at which Russian roulette may begin: never reached


def rgb(value):
    """Return Mitsuba's dict for three floats, or for one float on all channels."""
    channels = value if isinstance(value, list) else [value] * 3
    return {"type": "rgb", "value": [float(channel) for channel in channels]}


def color_of(value, folder):
    """Return the dict of a colour, or of the picture that a string names."""
    if isinstance(value, str):
        # By default 8 bits are kept in 16, which have no derivatives
        return {"type": "bitmap", "filename": str(folder / value), "format": "variant"}
    return rgb(value)


def bsdf_of(material, folder=Path()):
    """Return the BSDF dict of one `[materials.NAME]` table: two-sided, glass by nature."""
    if material["type"] == "glass":
        return {"type": "dielectric", "int_ior": float(material["ior"]), "ext_ior": 1.0}
    facets = {"distribution": "ggx", "alpha": float(material.get("roughness", 0.3)) ** 2}
    if material["type"] == "rough_glass":
        return {"type": "roughdielectric", "int_ior": float(material["ior"]), "ext_ior": 1.0, **facets}
    if material["type"] == "conductor":
        index = {name: rgb(material[name]) for name in ("eta", "k")}
        inner = {"type": "roughconductor", **index, **facets}
    elif material["type"] == "plastic":
        coat = {"int_ior": float(material.get("ior", 1.5)), "ext_ior": 1.0, "nonlinear": True}
        coat["diffuse_reflectance"] = color_of(material["albedo"], folder)
        smooth = material.get("roughness", 0.3) <= SMOOTHEST
        inner = {"type": "plastic", **coat} if smooth else {"type": "roughplastic", **coat, **facets}
    elif material["type"] == "mirror":
        albedo = color_of(material.get("albedo", 1.0), folder)
        inner = {"type": "conductor", "material": "none", "specular_reflectance": albedo}
    else:
        inner = {"type": "diffuse", "reflectance": color_of(material["albedo"], folder)}
    return {"type": "twosided", "bsdf": inner}


def sphere_of(mi, center, radius, **parts):
    """Return the dict of a sphere with the given bsdf or emitter parts."""
    return {"type": "sphere", "center": mi.ScalarPoint3f(*center), "radius": float(radius), **parts}


def polygons_of(mi, vertices, faces, bsdf):
    """Return the mesh of flat faces that arrays tell; a single triangle too, of which Mitsuba has none."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    properties["face_normals"] = True
    mesh = mi.Mesh("polygons", vertex_count=len(vertices), face_count=len(faces), props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.asarray(vertices, dtype=np.float32).ravel()
    parameters["faces"] = np.asarray(faces, dtype=np.uint32).ravel()
    parameters.update()
    return mesh


def mesh_of(mi, mesh, folder, bsdf):
    """Return the mesh of a `[[meshes]]` table: arrays as they are, or a Wavefront file, scaled, turned, moved."""
    turn = mi.ScalarTransform4f()
    for axis, angle in zip(np.eye(3).tolist(), mesh.get("rotate", [0, 0, 0]), strict=True):
        turn = mi.ScalarTransform4f().rotate(axis, angle) @ turn
    scale = mi.ScalarTransform4f().scale(mesh.get("scale", 1))
    place = mi.ScalarTransform4f().translate(mesh.get("translate", [0, 0, 0])) @ turn @ scale
    if "vertices" in mesh:
        vertices = [list(place @ mi.ScalarPoint3f(*vertex)) for vertex in mesh["vertices"]]
        return polygons_of(mi, vertices, mesh["faces"], bsdf)
    file = str(folder / mesh["file"])
    return {"type": "obj", "filename": file, "face_normals": not mesh.get("smooth"), "to_world": place, "bsdf": bsdf}


def light_of(mi, light):
    """Return the dict of a point light, or of a black sphere of radiance intensity / (π r²)."""
    radius = light.get("radius", 0)
    intensity = rgb(light["intensity"])
    if radius == 0:
        return {"type": "point", "position": mi.ScalarPoint3f(*light["position"]), "intensity": intensity}
    radiance = rgb([v / (math.pi * radius**2) for v in intensity["value"]])
    black = {"type": "diffuse", "reflectance": rgb(0.0)}
    emitter = {"type": "area", "radiance": radiance}
    return sphere_of(mi, light["position"], radius, emitter=emitter, bsdf=black)


def sensor_of(mi, camera, width, height, sampler="independent"):
    """Return the dict of a pinhole camera with vertical fov and a box-filtered linear RGB film.

    `look_at` hides Mitsuba's left-handed camera axes: for a view along -z the world's +x is on the right.
    """
    position = camera["position"]
    target = camera.get("target", [position[0], position[1], position[2] - 1])
    to_world = mi.ScalarTransform4f().look_at(origin=position, target=target, up=camera.get("up", [0, 1, 0]))
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    return {
        "type": "perspective",
        "fov": float(camera.get("fov", 60)),
        "fov_axis": "y",
        "to_world": to_world,
        "near_clip": 1e-3,
        "far_clip": 1e6,
        "film": film,
        "sampler": {"type": sampler},
    }


def scene_of(mi, path, options):
    """Return the Mitsuba scene of the jaxrt scene file at `path`; jaxrt's depth D is Mitsuba's D + 1."""
    text = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    cameras, defaults, folder = text.get("cameras") or [text["camera"]], text.get("render", {}), Path(path).parent
    depth = options.max_depth or defaults.get("max_depth", 5)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth + 1, "rr_depth": NO_ROULETTE},
    }
    for i, camera in enumerate(cameras):
        size = options.width or camera.get("width", 512), options.height or camera.get("height", 512)
        scene[f"sensor_{i}"] = sensor_of(mi, camera, *size, getattr(options, "sampler", "independent"))
    bsdfs = {name: bsdf_of(material, folder) for name, material in text.get("materials", {}).items()}
    scene |= {f"material_{name}": bsdf for name, bsdf in bsdfs.items()}
    for i, sphere in enumerate(text.get("spheres", [])):
        reference = {"type": "ref", "id": f"material_{sphere['material']}"}
        scene[f"sphere_{i}"] = sphere_of(mi, sphere["center"], sphere["radius"], bsdf=reference)
    for i, triangle in enumerate(text.get("triangles", [])):
        scene[f"triangle_{i}"] = polygons_of(mi, triangle["vertices"], [[0, 1, 2]], bsdfs[triangle["material"]])
    for i, mesh in enumerate(text.get("meshes", [])):
        scene[f"mesh_{i}"] = mesh_of(mi, mesh, folder, bsdfs[mesh["material"]])
    for i, light in enumerate(text.get("lights", [])):
        scene[f"light_{i}"] = light_of(mi, light)
    if "environment" in text:
        scene["environment"] = {"type": "constant", "radiance": rgb(text["environment"]["radiance"])}
    options.spp = options.spp or defaults.get("spp", 64)
    # Mitsuba merges meshes of one material, and their names are lost
    return mi.load_dict(scene, optimize=getattr(options, "optimize", True))


def render(mi, dr, scene, spp, seed):
    """Return the (H, W, 3) image, complete when this returns: Dr.Jit is lazy and asynchronous."""
    image = mi.render(scene, spp=spp, seed=seed)
    dr.eval(image)
    dr.sync_thread()
    return image


def clocked(action):
    """Return {"wall", "cpu"} seconds of one call; cpu counts every thread of this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}


def run_time(mi, dr, scene, options):
    """Return seconds of the first call, which compiles, and of `repeat` later ones."""
    first = clocked(lambda: render(mi, dr, scene, options.spp, options.seed))
    later = [
        clocked(lambda seed=options.seed + 1 + i: render(mi, dr, scene, options.spp, seed))
        for i in range(options.repeat)
    ]
    width, height = scene.sensors()[0].film().size()
    compile_wall = first["wall"] - statistics.median(call["wall"] for call in later)
    paths = int(width) * int(height) * options.spp
    return {"paths": paths, "compile": compile_wall, "first": first, "calls": later}


def run_image(mi, dr, scene, options):
    """Save images (seeds, H, W, 3) float32, one for each seed from `seed` on."""
    seeds = range(options.seed, options.seed + options.seeds)
    images = np.stack([np.array(render(mi, dr, scene, options.spp, seed)) for seed in seeds])
    np.savez_compressed(options.out, images=images, spp=options.spp, seeds=list(seeds))
    return {"out": options.out, "mean": images.mean(axis=(0, 1, 2)).tolist()}


def run_cold(mi, dr, scene, options):
    """Render once and write the picture."""
    mi.util.write_bitmap(options.out, render(mi, dr, scene, options.spp, options.seed), write_async=False)
    return {"out": options.out}


def arguments():
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Render a jaxrt scene file with Mitsuba 3.")
    parser.add_argument("command", choices=["time", "image", "cold"])
    parser.add_argument("scene")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    for name in ("width", "height", "spp", "max-depth"):
        parser.add_argument(f"--{name}", type=int, help="default: the scene's")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=16, help="number of images of `image`")
    parser.add_argument("--repeat", type=int, default=3, help="timed calls of `time` after the first")
    parser.add_argument("--out", help="file of `image` (.npz) or `cold` (.png)")
    return parser.parse_args()


def main():
    """Run one command and print its JSON."""
    options = arguments()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(options.variant)
    dr.set_thread_count(options.cores)
    scene = scene_of(mi, options.scene, options)
    command = {"time": run_time, "image": run_image, "cold": run_cold}[options.command]
    report = command(mi, dr, scene, options)
    kilobyte = 1 if sys.platform == "darwin" else 1024
    report["peak_bytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * kilobyte
    report["version"] = mi.__version__
    print(json.dumps(report))


if __name__ == "__main__":
    main()
