"""Embree's half of the comparison of searches, through Mitsuba: a plain script in Mitsuba's own environment.

python benchmarks/mesh_mitsuba.py RAYS.npz    prints JSON: Mrays per CPU second and share of hits, by kind and search
"""

import argparse
import json
import os
import time

import mitsuba_side
import numpy as np
from mesh_rays import KINDS, OPEN, in_the_open, room


def picture_of(mi, text):
    """Return the scene of a description with one mesh; jaxrt's depth D is Mitsuba's D + 1."""
    camera, depth = text["camera"], text["render"]["max_depth"]
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth + 1, "rr_depth": mitsuba_side.NO_ROULETTE},
        "sensor": mitsuba_side.sensor_of(mi, camera, camera["width"], camera["height"]),
        "light": mitsuba_side.light_of(mi, text["lights"][0]),
    }
    bsdfs = {name: mitsuba_side.bsdf_of(material) for name, material in text["materials"].items()}
    for i, sphere in enumerate(text["spheres"]):
        bsdf = bsdfs[sphere["material"]]
        scene[f"sphere_{i}"] = mitsuba_side.sphere_of(mi, sphere["center"], sphere["radius"], bsdf=bsdf)
    mesh = text["meshes"][0]
    scene["mesh"] = mitsuba_side.polygons_of(mi, mesh["vertices"], mesh["faces"], bsdfs[mesh["material"]])
    return mi.load_dict(scene), camera["width"] * camera["height"] * text["render"]["spp"]


def time_picture(mi, dr, text, repeat):
    """Return [million camera paths per CPU second, mean radiance] of a description."""
    scene, paths = picture_of(mi, text)
    seconds = []
    for seed in range(repeat + 1):
        start = time.process_time()
        image = mitsuba_side.render(mi, dr, scene, 16, seed)
        seconds.append(time.process_time() - start)
    return [paths / 1e6 / float(np.median(seconds[1:])), float(np.array(image).mean())]


def main():
    """Measure each kind of ray with and without Embree's coherent flag, and print the better."""
    parser = argparse.ArgumentParser(description="Measure Embree through Mitsuba.")
    parser.add_argument("file")
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--picture", action="store_true", help="also a whole picture")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    file = np.load(options.file)
    mesh, report = mitsuba_side.polygons_of(mi, file["vertices"], file["faces"], {"type": "diffuse"}), {}
    scene = mi.load_dict({"type": "scene", "mesh": mesh})
    for name, (rays, any_hit) in KINDS.items():
        best = [0.0, 0.0]
        ray = mi.Ray3f(mi.Point3f(file[f"{rays}_o"].T), mi.Vector3f(file[f"{rays}_d"].T))
        if f"{rays}_reach" in file:
            ray.maxt = mi.Float(file[f"{rays}_reach"])
        dr.eval(ray)
        for coherent in (False, True):
            seconds = []
            for _ in range(options.repeat + 1):
                start = time.process_time()
                found = (scene.ray_test if any_hit else scene.ray_intersect_preliminary)(ray, coherent=coherent)
                dr.eval(found)
                dr.sync_thread()
                seconds.append(time.process_time() - start)
            hits = np.asarray(found if any_hit else found.is_valid()).mean()
            best = max(best, [dr.width(ray) / 1e6 / float(np.median(seconds[1:])), float(hits)])
        report[name] = best
    if options.picture:
        report["picture"] = time_picture(mi, dr, room(file["vertices"], file["faces"]), 2)
        for name in OPEN:
            text = in_the_open(file[f"{name}_vertices"], file[f"{name}_faces"])
            report[f"{name} in the open"] = time_picture(mi, dr, text, 2)
    print(json.dumps(report))


if __name__ == "__main__":
    main()
