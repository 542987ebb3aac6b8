"""Mitsuba's half of `benchmarks.poses`: the first mesh's pose by Adam, on the gradient of a projective integrator.

Runs in Mitsuba's own environment as a plain script:

    python benchmarks/mitsuba_poses.py SCENE TASKS.npz --rate 0.05 --steps 200 --spp 32

TASKS.npz has `targets` (n, H, W, 3) and `starts` (n, 6), places and rotation vectors in degrees. Poses are no
parameters of Mitsuba's: the vertices are, and six numbers move them. Prints a line of JSON for each task: pose and CPU
seconds.
"""

import argparse
import json
import time
import tomllib
from pathlib import Path

import numpy as np
from mitsuba_side import mesh_of, scene_of

KEY = "mesh_0.vertex_positions"
LAST = 0.1  # share of the rate that the last step has


def main():
    """Answer all tasks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("tasks")
    parser.add_argument("--integrator", default="direct_projective")
    parser.add_argument("--guiding", default="none", help="of edge samples; octree, the default, does not finish here")
    parser.add_argument("--rate", type=float, default=0.05)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--spp", type=int, default=32)
    options = parser.parse_args()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    tasks = np.load(options.tasks)
    fitter = Fitter(mi, dr, options, tasks["targets"].shape[1:3])
    fitter.fit(tasks["targets"][0], tasks["starts"][0], 2)  # compiles
    for target, start in zip(tasks["targets"], tasks["starts"], strict=True):
        begin = time.process_time()
        pose = fitter.fit(target, start, options.steps)
        print(json.dumps({"pose": pose, "seconds": time.process_time() - begin}), flush=True)


class Fitter:
    """The scene, with the mesh's own vertices."""

    def __init__(self, mi, dr, options, size):
        self.mi, self.dr, self.options = mi, dr, options
        height, width = size
        how = argparse.Namespace(width=width, height=height, max_depth=None, spp=None, optimize=False)
        self.scene = scene_of(mi, options.scene, how)
        self.parameters = mi.traverse(self.scene)
        mesh = tomllib.loads(Path(options.scene).read_text())["meshes"][0]
        alone = mi.load_dict(mesh_of(mi, {"file": mesh["file"]}, Path(options.scene).parent, {"type": "diffuse"}))
        self.vertices = dr.unravel(mi.Point3f, mi.traverse(alone)["vertex_positions"])
        self.integrator = mi.load_dict({"type": options.integrator, "guiding": options.guiding})

    def pose(self, place, turn):
        """Move the vertices: turned about the mesh's origin, then moved."""
        mi, dr = self.mi, self.dr
        angle = dr.norm(turn)
        placed = mi.Transform4f().translate(place).rotate(turn / angle, dr.rad2deg(angle))
        self.parameters[KEY] = dr.ravel(placed @ self.vertices)
        self.parameters.update()

    def fit(self, target, start, steps):
        """Return the pose after all steps of Adam, each on samples of its own."""
        mi, dr = self.mi, self.dr
        target, rate = mi.TensorXf(np.asarray(target, np.float32)), self.options.rate
        optimizer = mi.ad.Adam(lr=rate)
        optimizer["place"] = mi.Point3f(*map(float, start[:3]))
        optimizer["turn"] = mi.Vector3f(*map(float, np.deg2rad(start[3:])))
        for i in range(steps):
            optimizer.set_learning_rate(rate * LAST ** (i / steps))
            self.pose(optimizer["place"], optimizer["turn"])
            seeds = {"seed": 2 * i + 2, "seed_grad": 2 * i + 3}
            image = mi.render(self.scene, self.parameters, integrator=self.integrator, spp=self.options.spp, **seeds)
            dr.backward(dr.mean(dr.square(image - target), axis=None))
            optimizer.step()
        place, turn = (np.array(optimizer[name]).ravel() for name in ("place", "turn"))
        return [*map(float, place), *map(float, np.rad2deg(turn))]


if __name__ == "__main__":
    main()
