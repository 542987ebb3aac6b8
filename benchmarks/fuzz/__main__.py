"""`python -m benchmarks.fuzz --seed S --scenes N --files M`: files that are wrong, and what became of them.

Prints for each kind how many were read, refused in one line, and had a fault; then each fault. Exit status 1 for any.
"""

import argparse
import faulthandler
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.fuzz import meshes, pictures, reports, scenes
from benchmarks.fuzz.judge import run, traps
from benchmarks.fuzz.values import BOX


def read_scene(path: Path) -> Any:
    """Return the scene in a file, built, its parameters finite. Compiles no picture."""
    import numpy as np

    import jaxrt

    scene = jaxrt.load_scene(path)
    assert all(np.isfinite(value).all() for value in jaxrt.parameters(scene).values())
    return scene


def read_target(path: Path) -> Any:
    """Return the picture in a file as `jaxrt diff` reads it; `jaxrt fit` must leave out what is not finite."""
    import numpy as np

    from jaxrt.fit.files import load_target
    from jaxrt.io.image import load_image

    image, target = load_image(path), load_target(path)
    assert np.isfinite(target.image).all() and target.image.shape == target.weight.shape == image.shape
    return image


def report_reader(scene_file: Path) -> Callable[[Path], Any]:
    """Return what reads a fit.json of the scene's light."""
    import jaxrt
    from jaxrt.fit import unknowns_of
    from jaxrt.fit.files import read_progress
    from jaxrt.scene.selectors import parse_selector

    scene_file.write_text(scenes.scene())
    scene, name = jaxrt.load_scene(scene_file), "lights.position[0]"
    unknowns = unknowns_of(scene, {name: parse_selector(name, scene)})
    return lambda path: read_progress(path, unknowns)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scenes", type=int, default=3600, metavar="N", help="scene files (3600)")
    parser.add_argument(
        "--files", type=int, default=2600, metavar="M", help="pictures, and a third of them fit.json (2600)"
    )
    parser.add_argument("--meshes", type=int, default=5000, metavar="K", help="mesh files (5000)")
    args = parser.parse_args()
    faulthandler.enable()
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "box.obj").write_text(BOX)
        traps(folder)
        share = args.files // 3
        for title, cases, read in (
            ("scene files", scenes.mutations(args.seed, args.scenes), read_scene),
            ("pictures", pictures.mutations(args.seed, args.files - share), read_target),
            ("fit.json", reports.mutations(args.seed, share), report_reader(folder / "scene.toml")),
        ):
            start = time.perf_counter()
            counts, faults = run(cases, folder, read)
            told = ", ".join(f"{count} {what}" for what, count in counts.items())
            print(f"{title:12} {told}, {time.perf_counter() - start:.1f} s", flush=True)
            for verdict in faults:
                print(f"  {verdict.fault}: {verdict.case.name[:80]}: {verdict.text[-400:]}")
            bad += len(faults)
    bad += meshes.report(args.seed, args.meshes)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
