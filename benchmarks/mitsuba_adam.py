"""The peer's half of `benchmarks.adam`: the albedos of a scene, sought with Adam on gradients of path replay (prb).

Runs in Mitsuba's own environment as a plain script:

    python benchmarks/mitsuba_adam.py SCENE --width 64 --height 64 --spp 8 --steps 100

Prints one line of JSON: seconds of the target, of the first step, of the others and from the start of the process, and
how far the albedos are off at the end.
"""

import json
import time
import tomllib
from pathlib import Path

from adam_task import adam_parser
from mitsuba_side import NO_ROULETTE, scene_of

BEGIN = time.perf_counter()


def arguments():
    """Return the parsed command line, with what `scene_of` asks for."""
    options = adam_parser().parse_args()
    options.max_depth = options.max_depth or tomllib.loads(Path(options.scene).read_text())["render"]["max_depth"]
    return options


def main():
    """Fit, and print."""
    options = arguments()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    scene = scene_of(mi, options.scene, options)
    # As `scene_of` counts: with the camera's edge
    integrator = mi.load_dict({"type": "prb", "max_depth": options.max_depth + 1, "rr_depth": NO_ROULETTE})
    times = {"start": time.perf_counter() - BEGIN}
    target = mi.render(scene, spp=options.target_spp, seed=2**31)
    dr.eval(target)
    dr.sync_thread()
    times["target"] = time.perf_counter() - BEGIN - times["start"]
    error = adam(mi, dr, scene, integrator, target, options, times)
    print(json.dumps(times | {"error": error, "total": time.perf_counter() - BEGIN}))


def adam(mi, dr, scene, integrator, target, options, times):
    """Take all steps of Adam, each on samples of its own, and return the mean error of the albedos."""
    parameters = mi.traverse(scene)
    names = [name for name in parameters.keys() if name.endswith("reflectance.value") and "light" not in name]
    truth = {name: [float(channel[0]) for channel in parameters[name]] for name in names}
    optimizer = mi.ad.Adam(lr=options.rate)
    for name in names:
        optimizer[name] = mi.Color3f(0.5)
    begin = time.perf_counter()
    for i in range(options.steps):
        parameters.update(optimizer)
        image = mi.render(scene, parameters, integrator=integrator, spp=options.spp, seed=2 * i, seed_grad=2 * i + 1)
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        optimizer.step()
        for name in names:
            optimizer[name] = dr.clip(optimizer[name], 0.01, 0.99)
        if i == 0:
            dr.eval(optimizer)
            dr.sync_thread()
            times["first"] = time.perf_counter() - begin
    off = [abs(float(optimizer[name][c][0]) - truth[name][c]) for name in names for c in range(3)]
    times["others"] = time.perf_counter() - begin - times["first"]
    return sum(off) / len(off)


if __name__ == "__main__":
    main()
