"""The peer's half of `benchmarks.textures`: a texture of a scene, sought with Adam on gradients of path replay (prb).

Runs in Mitsuba's own environment as a plain script:

    python benchmarks/mitsuba_textures.py SCENE VISIBLE.npy --rates 0.02

Texels are what Adam moves, clipped to [0, 1] after each step. Prints a line of JSON, a report for each rate: CPU and
wall seconds of the steps but for the first few, which compile, the mean loss of the last tenth of them, and the PSNR
along the way.
"""

import json
import math
import time
import tomllib
from pathlib import Path

import numpy as np
from mitsuba_side import NO_ROULETTE, scene_of
from texture_task import TOLD, rate_at, texture_parser, told_after


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
    parameters = mi.traverse(scene)
    # The mesh has a copy of its material
    key = next(name for name in parameters.keys() if name.startswith("mesh") and name.endswith("reflectance.data"))
    if options.texels:
        parameters[key] = mi.TensorXf(np.load(options.texels))
        parameters.update()
    truth = np.array(parameters[key])[..., :3]
    targets = [mi.render(scene, sensor=view, spp=options.target_spp, seed=2**31 + view) for view in views]
    dr.eval(targets)
    dr.sync_thread()
    begin = scene, parameters, key, truth, integrator, targets, options
    print(json.dumps({"fits": [{"rate": rate, **fit(mi, dr, rate, *begin)} for rate in options.rates]}))


def fit(mi, dr, rate, scene, parameters, key, truth, integrator, targets, options):
    """Take all steps of Adam, each on samples of its own in one of the views, and return what they come to."""
    visible, steps = np.load(options.visible), options.steps
    optimizer = mi.ad.Adam(lr=rate)
    optimizer[key] = mi.TensorXf(np.full_like(truth, 0.5))
    psnr, losses, begin = [], [], None
    for i in range(steps + options.more):
        optimizer.set_learning_rate(rate_at(i, rate, options))
        parameters.update(optimizer)
        view, seeds = i % len(targets), {"seed": 2 * i, "seed_grad": 2 * i + 1}
        image = mi.render(scene, parameters, sensor=view, integrator=integrator, spp=options.spp, **seeds)
        loss = dr.mean(dr.square(image - targets[view]), axis=None)
        dr.backward(loss)
        optimizer.step()
        optimizer[key] = dr.clip(optimizer[key], 0, 1)
        dr.eval(optimizer[key])
        if i + 1 == len(targets):
            dr.sync_thread()
            begin = time.process_time(), time.perf_counter()
        if steps - steps // TOLD <= i < steps:
            losses.append(float(loss.array[0]))
        if i + 1 == steps:
            dr.sync_thread()
            cpu, wall = time.process_time() - begin[0], time.perf_counter() - begin[1]
        if told_after(i + 1, options):
            off = (np.array(optimizer[key]) - truth)[visible]
            psnr.append(-10 * math.log10(np.mean(off**2)))
    return {"psnr": psnr, "loss": float(np.mean(losses)), "cpu": cpu, "wall": wall}


if __name__ == "__main__":
    main()
