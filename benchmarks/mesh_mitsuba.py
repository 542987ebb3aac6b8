"""Embree's half of the comparison of searches, through Mitsuba: a plain script in Mitsuba's own environment.

python benchmarks/mesh_mitsuba.py RAYS.npz    prints JSON: Mrays per CPU second and share of hits, by kind and search
"""

import argparse
import json
import os
import time

import numpy as np


def scene_of(mi, vertices, faces):
    """Return a scene of one mesh."""
    mesh = mi.Mesh("mesh", vertex_count=len(vertices), face_count=len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return mi.load_dict({"type": "scene", "mesh": mesh})


def main():
    """Measure each kind of ray with and without Embree's coherent flag, and print the better."""
    parser = argparse.ArgumentParser(description="Measure Embree through Mitsuba.")
    parser.add_argument("file")
    parser.add_argument("--repeat", type=int, default=7)
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    file = np.load(options.file)
    scene, report = scene_of(mi, file["vertices"], file["faces"]), {}
    for name, any_hit in (("camera", False), ("shadow", True), ("incoherent", False), ("incoherent any", True)):
        kind, best = name.split()[0], [0.0, 0.0]
        ray = mi.Ray3f(mi.Point3f(file[f"{kind}_o"].T), mi.Vector3f(file[f"{kind}_d"].T))
        if kind == "shadow":
            ray.maxt = mi.Float(file["shadow_reach"])
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
    print(json.dumps(report))


if __name__ == "__main__":
    main()
