"""Mitsuba's half of the charts: a plain script in Mitsuba's own environment that answers until its input ends.

Each line of the input is a JSON object: {"scene", "width", "height", "sampler", "spp", "seed", "out"} asks for a
picture; with "integrator" and "axis", for its derivative with respect to that coordinate of the point light; with
"integrator", "max_depth", "guiding", "moved" and "motion", as these things move. The image goes to the file `out`
(.npy); the answer is a line of JSON behind `ANSWER`: CPU seconds, or the error.
"""

import argparse
import json
import os
import time
from functools import cache

import mitsuba_edges
import numpy as np
from mitsuba_gradients import derivative, integrator_of
from mitsuba_side import render, scene_of

ANSWER = "ANSWER "


def reason(error):
    """Return the first sentence of the message of what began it."""
    while error.__cause__ is not None:
        error = error.__cause__
    return str(error).strip().splitlines()[0].split("! ")[0].split(". ")[0]


def main():
    """Answer."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    mi.set_log_level(mi.LogLevel.Error)

    @cache
    def scene(path, width, height, sampler, optimize=True):
        options = argparse.Namespace(width=width, height=height, sampler=sampler, max_depth=None, spp=None)
        options.optimize = optimize
        return scene_of(mi, path, options)

    @cache
    def integrator(name):
        return integrator_of(mi, name)

    @cache
    def edge_integrator(name, depth, guiding):
        return mitsuba_edges.integrator_of(mi, name, depth, guiding)

    def moved(task):
        subject = scene(task["scene"], task["width"], task["height"], task["sampler"], optimize=False)
        method = edge_integrator(task["integrator"], task["max_depth"], task["guiding"])
        return mitsuba_edges.derivative(
            mi, dr, subject, method, task["moved"], task["motion"], task["spp"], task["seed"]
        )

    def image(task):
        if "moved" in task:
            return moved(task)
        subject = scene(task["scene"], task["width"], task["height"], task["sampler"])
        if "integrator" in task:
            method = integrator(task["integrator"])
            return derivative(mi, dr, subject, method, task["axis"], task["spp"], task["seed"])
        return np.array(render(mi, dr, subject, task["spp"], task["seed"]))

    print(ANSWER + json.dumps({"version": mi.__version__}), flush=True)
    while True:
        try:
            task = json.loads(input())
        except EOFError:
            return
        try:
            start = time.process_time()
            picture = image(task)
            answer = {"seconds": time.process_time() - start}
            np.save(task["out"], picture)
        except Exception as error:  # what it says is the answer
            answer = {"error": reason(error)}
            scene.cache_clear()  # derivatives may still be attached to it
        print(ANSWER + json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
