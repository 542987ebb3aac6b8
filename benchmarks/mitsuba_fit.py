"""The peer's half of `benchmarks.fit_light`: the same light, sought with Adam on a gradient of Mitsuba's.

Runs in Mitsuba's own environment as a plain script:

    python benchmarks/mitsuba_fit.py SCENE --integrator direct_projective --start X Y Z --rate 0.1 --steps 200 --spp 16

Mitsuba 3.9.1 has no derivative in the place of a point light (prb raises, direct_projective returns 0), so the point is
a small sphere here, whose transformation has one. Prints one line of JSON: position, error, and seconds of the solve
and from the start of the process.
"""

import argparse
import json
import time
import tomllib
from pathlib import Path

from mitsuba_side import bsdf_of, light_of, polygons_of, sensor_of, sphere_of

BEGIN = time.perf_counter()


def main():
    """Fit, and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("--integrator", default="direct_projective")
    parser.add_argument("--start", type=float, nargs=3, required=True)
    parser.add_argument("--rate", type=float, default=0.1)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--guiding", default="none", help="of edge samples; octree, the default, does not finish here")
    parser.add_argument("--radius", type=float, default=0.3)
    options = parser.parse_args()
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)  # its warnings go where the report goes
    scene = mi.load_dict(description_of(mi, options))
    parameters = mi.traverse(scene)
    integrator = mi.load_dict({"type": options.integrator, "guiding": options.guiding})
    target = mi.render(scene, spp=16 * options.spp, seed=1)
    begin = time.perf_counter()
    position = adam(mi, scene, parameters, integrator, target, options)
    seconds = time.perf_counter() - begin
    truth = tomllib.loads(Path(options.scene).read_text())["lights"][0]["position"]
    error = sum((a - b) ** 2 for a, b in zip(position, truth, strict=True)) ** 0.5
    total = time.perf_counter() - BEGIN
    print(json.dumps({"position": position, "error": error, "solve": seconds, "total": total}))


def description_of(mi, options):
    """Return the scene's dict, with a small sphere for the point light, placed by its transformation."""
    text = tomllib.loads(Path(options.scene).read_text())
    camera, light = text["camera"], text["lights"][0]
    scene = {"type": "scene", "integrator": {"type": "direct"}}
    scene["sensor"] = sensor_of(mi, camera, camera["width"], camera["height"])
    scene["sensor"]["film"]["sample_border"] = True  # as it asks for derivatives
    for i, sphere in enumerate(text["spheres"]):
        bsdf = bsdf_of(text["materials"][sphere["material"]])
        scene[f"sphere_{i}"] = sphere_of(mi, sphere["center"], sphere["radius"], bsdf=bsdf)
    for i, triangle in enumerate(text["triangles"]):
        bsdf = bsdf_of(text["materials"][triangle["material"]])
        scene[f"triangle_{i}"] = polygons_of(mi, triangle["vertices"], [[0, 1, 2]], bsdf)
    scene["light"] = light_of(mi, {**light, "intensity": [light["intensity"][0]] * 3, "radius": options.radius})
    del scene["light"]["center"], scene["light"]["radius"]
    scene["light"]["to_world"] = mi.ScalarTransform4f().translate(light["position"]).scale(options.radius)
    return scene


def adam(mi, scene, parameters, integrator, target, options):
    """Return the position after all steps of Adam, each on samples of its own."""
    import drjit as dr

    optimizer = mi.ad.Adam(lr=options.rate)
    optimizer["place"] = mi.Point3f(*options.start)
    for i in range(options.steps):
        parameters["light.to_world"] = mi.Transform4f().translate(optimizer["place"]).scale(options.radius)
        parameters.update()
        image = mi.render(
            scene, parameters, integrator=integrator, spp=options.spp, seed=2 * i + 2, seed_grad=2 * i + 3
        )
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        optimizer.step()
    found = optimizer["place"]
    return [float(found.x[0]), float(found.y[0]), float(found.z[0])]


if __name__ == "__main__":
    main()
