"""Mitsuba's half of `edge_peer.py`: pictures of a jaxrt scene file, and their derivatives as something in it moves.

Runs in Mitsuba's own environment as a plain script: writes arrays (seeds, H, W, 3) of pictures and of derivatives by
integrator, and prints one line of JSON, {integrator: what it raises}.
"""

import argparse
import json

import numpy as np
from mitsuba_side import NO_ROULETTE, render, scene_of

SEED_SPP = 4096


def motion(mi, kind, theta):
    """Return the transform of the world that a parameter theta stands for, the identity at 0."""
    if kind == "scale":
        return mi.Transform4f().scale(mi.Vector3f(1 + theta))
    return mi.Transform4f().translate(mi.Vector3f(theta, 0, 0))


def move(mi, dr, parameters, start, transform):
    """Set the parameters to where a transform takes them: places of lights and of the camera, or vertices."""
    for key, value in start.items():
        if key.endswith(".to_world"):
            parameters[key] = transform @ value
        else:
            parameters[key] = dr.ravel(transform @ dr.unravel(mi.Point3f, value))
    parameters.update()


def derivative(mi, dr, scene, integrator, moved, kind, spp, seed):
    """Return the derivative picture (H, W, 3) as what is named moves, by forward differentiation."""
    parameters = mi.traverse(scene)
    of = {"mesh": "vertex_positions"}
    keys = [f"{name}.{of.get(name.split('_')[0], 'to_world')}" for name in moved]
    start = {key: type(parameters[key])(parameters[key]) for key in keys}
    theta = mi.Float(0)
    dr.enable_grad(theta)
    move(mi, dr, parameters, start, motion(mi, kind, theta))
    try:
        dr.forward(theta, dr.ADFlag.ClearEdges)
        return np.array(dr.detach(integrator.render_forward(scene, params=theta, seed=seed, spp=spp)))
    finally:
        # Else the next one's start would still hang on theta
        move(mi, dr, parameters, start, motion(mi, kind, mi.Float(0)))


def derivatives(mi, dr, options, integrator):
    """Return the derivative pictures (seeds, H, W, 3)."""
    scene = scene_of(mi, options.scene, options)
    moved, kind = options.moved, options.motion
    return np.stack(
        [derivative(mi, dr, scene, integrator, moved, kind, options.spp, seed) for seed in range(options.seeds)]
    )


def integrator_of(mi, name, depth, guiding=SEED_SPP):
    """Return an integrator of paths of so many events; `direct_projective` has one event always."""
    integrator = mi.load_dict({"type": name} | ({} if "direct" in name else {"max_depth": depth + 1}))
    integrator.rr_depth = NO_ROULETTE
    integrator.proj_seed_spp = guiding
    return integrator


def arguments():
    """Return the parsed command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("out")
    parser.add_argument("--motion", choices=["translate", "scale"])
    parser.add_argument("--moved", nargs="+")
    parser.add_argument("--integrators", nargs="+")
    parser.add_argument("--max-depth", type=int)
    parser.add_argument("--spp", type=int)
    parser.add_argument("--seeds", type=int)
    return parser.parse_args()


def main():
    """Save the arrays and print what was raised."""
    options = arguments()
    options.width = options.height = None
    options.optimize = False
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    scene = scene_of(mi, options.scene, options)
    pictures = [np.array(render(mi, dr, scene, options.spp, seed)) for seed in range(options.seeds)]
    arrays, raised = {"pictures": np.stack(pictures)}, {}
    for name in options.integrators:
        try:
            arrays[name] = derivatives(mi, dr, options, integrator_of(mi, name, options.max_depth))
        except Exception as error:  # what it says is the answer
            raised[name] = f"{type(error).__name__}: {error}"
    np.savez(options.out, **arrays)
    print(json.dumps(raised))


if __name__ == "__main__":
    main()
