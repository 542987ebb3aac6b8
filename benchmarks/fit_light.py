"""A point light from its hard shadow: jaxrt with Levenberg-Marquardt, Mitsuba with Adam on its best gradient.

    python -m benchmarks.fit_light [--steps 100] [--peer-python PATH]

Floor, ball and light, max_depth 1, 64x64 pixels, the start of examples/fit_light_position.py. jaxrt runs that example
with an empty cache: its own lines tell steps, error, seconds of the solve and from the start of the process. Mitsuba
has no derivative in the place of a point light, and gets a sphere of radius 0.3 instead; its octree of edge samples,
the default, does not finish, so they are not guided.
"""

import argparse
import sys
import tempfile

from benchmarks.processes import HERE, cpu_model, find_peer, report_of, run_child, wide_console

SCENE = "scenes/hanging_ball.toml"
START = ("0", "8.5", "2")


def main() -> None:
    """Run both, and print what they found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100, help="of Adam")
    parser.add_argument("--rate", type=float, default=0.05, help="of Adam")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    options, console = parser.parse_args(), wide_console()
    console.print(cpu_model())
    with tempfile.TemporaryDirectory() as folder:
        ours = run_child([sys.executable, "examples/fit_light_position.py", "--output", folder], folder)
    console.print(f"jaxrt, cold total {ours.seconds:.1f} s, both fits:\n{ours.output}", markup=False)
    python, message = find_peer(options.peer_python)
    console.print(message)
    if not python:
        return
    command = [python, str(HERE / "mitsuba_fit.py"), SCENE, "--start", *START]
    command += ["--steps", str(options.steps), "--rate", str(options.rate)]
    with tempfile.TemporaryDirectory() as folder:
        theirs = report_of(run_child(command, folder))
    place = ", ".join(f"{v:.3f}" for v in theirs["position"])
    console.print(
        f"Mitsuba, direct_projective and Adam, {options.steps} steps: [{place}], off by {theirs['error']:.3f}; "
        f"solve {theirs['solve']:.1f} s, cold total {theirs['total']:.1f} s",
        markup=False,
    )


if __name__ == "__main__":
    main()
