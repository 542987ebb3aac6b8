"""The peer's half of `benchmarks.textures`: a texture of a scene, sought with Adam on gradients of path replay (prb).

Runs in Mitsuba's own environment as a plain script:

    python benchmarks/mitsuba_textures.py SCENE VISIBLE.npy --rate 0.02

Texels are what Adam moves, clipped to [0, 1] after each step. Prints a line of JSON: CPU and wall seconds of the steps
but for the first few, which compile, and the PSNR along the way.
"""

import json
import math
import time
import tomllib
from pathlib import Path

import numpy as np
from mitsuba_side import NO_ROULETTE, scene_of
from texture_task import TOLD, rate_at, texture_parser


def main():
    """Fit, and print."""
    options = texture_parser().parse_args()
    options.max_depth = options.max_depth or tomllib.loads(Path(options.scene).read_text())["render"]["max_depth"]
    options.optimize = False  # names would be lost
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    scene = scene_of(mi, options.scene, options)
    # As `scene_of` counts: with the camera's edge
    integrator = mi.load_dict({"type": "prb", "max_depth": options.max_depth + 1, "rr_depth": NO_ROULETTE})
    views = range(len(scene.sensors()))
    targets = [mi.render(scene, sensor=view, spp=options.target_spp, seed=2**31 + view) for view in views]
    dr.eval(targets)
    dr.sync_thread()
    print(json.dumps(fit(mi, dr, scene, integrator, targets, options)))


def fit(mi, dr, scene, integrator, targets, options):
    """Take all steps of Adam, each on samples of its own in one of the views, and return what they come to."""
    parameters = mi.traverse(scene)
    # The mesh has a copy of its material
    key = next(name for name in parameters.keys() if name.startswith("mesh") and name.endswith("reflectance.data"))
    truth, visible = np.array(parameters[key])[..., :3], np.load(options.visible)
    optimizer = mi.ad.Adam(lr=options.rate)
    optimizer[key] = mi.TensorXf(np.full_like(truth, 0.5))
    psnr, begin = [], None
    for i in range(options.steps):
        optimizer.set_learning_rate(rate_at(i, options))
        parameters.update(optimizer)
        view, seeds = i % len(targets), {"seed": 2 * i, "seed_grad": 2 * i + 1}
        image = mi.render(scene, parameters, sensor=view, integrator=integrator, spp=options.spp, **seeds)
        dr.backward(dr.mean(dr.square(image - targets[view]), axis=None))
        optimizer.step()
        optimizer[key] = dr.clip(optimizer[key], 0, 1)
        dr.eval(optimizer[key])
        if i + 1 == len(targets):
            dr.sync_thread()
            begin = time.process_time(), time.perf_counter()
        if (i + 1) % max(1, options.steps // TOLD) == 0:
            off = (np.array(optimizer[key]) - truth)[visible]
            psnr.append(-10 * math.log10(np.mean(off**2)))
    dr.sync_thread()
    cpu, wall = time.process_time() - begin[0], time.perf_counter() - begin[1]
    return {"psnr": psnr, "cpu": cpu, "wall": wall}


if __name__ == "__main__":
    main()
