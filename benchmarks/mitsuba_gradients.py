"""Mitsuba's derivatives of a scene file's picture with respect to its point light's position, by integrator.

Runs in Mitsuba's own environment as a plain script: prints one line of JSON, {integrator: three pictures, one for each
coordinate, or the error it raises}.
"""

import argparse
import json

import numpy as np
from mitsuba_side import NO_ROULETTE, scene_of

INTEGRATORS = ("path", "direct_projective", "prb", "prb_projective")


def derivative(mi, dr, scene, integrator, axis, spp=1024, seed=1):
    """Return the derivative picture with respect to one coordinate of the light, by forward differentiation."""
    parameters = mi.traverse(scene)
    (name,) = (key for key in parameters.keys() if key.endswith("position") and "light" in key)
    shift = mi.Float(0)
    dr.enable_grad(shift)
    start = mi.Point3f(parameters[name])
    parameters[name] = start + shift * mi.Vector3f(*np.eye(3)[axis].tolist())
    parameters.update()
    try:
        dr.forward(shift, dr.ADFlag.ClearEdges)
        picture = mi.render(scene, parameters, integrator=integrator, spp=spp, seed=seed)
        return np.array(dr.forward_to(picture))
    finally:
        parameters[name] = start
        parameters.update()


def integrator_of(mi, name):
    """Return an integrator of direct light."""
    depth = {} if "direct" in name else {"max_depth": 2, "rr_depth": NO_ROULETTE}
    return mi.load_dict({"type": name, **depth})


def main():
    """Print the answers."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    options = parser.parse_args()
    options.width = options.height = options.max_depth = options.spp = None
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    scene = scene_of(mi, options.scene, options)
    answers = {}
    for name in INTEGRATORS:
        integrator = integrator_of(mi, name)
        try:
            answers[name] = [derivative(mi, dr, scene, integrator, axis).tolist() for axis in range(3)]
        except Exception as error:  # what it says is the answer
            answers[name] = f"raises {type(error).__name__}"
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
