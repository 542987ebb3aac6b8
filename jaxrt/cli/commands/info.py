"""`jaxrt info`."""

import argparse

from jaxrt.cli import start
from jaxrt.cli.commands.summary import print_summary
from jaxrt.cli.start import built
from jaxrt.io.scene_file import read_description
from jaxrt.programs import is_kept
from jaxrt.render import prepare
from jaxrt.scene.checks import check_memory


def run(args: argparse.Namespace) -> None:
    """Print what is in a scene, and whether its program is kept."""
    description = read_description(args.scene, args.allow_folder)
    check_memory(description.camera.width, description.camera.height, str(args.scene))
    folder = start.start_jax(1)
    messages: list[object] = []
    scene = built(description, messages.append)
    print_summary(str(args.scene), description, scene, [str(message) for message in messages])
    arguments = prepare(scene, 0, 0, 0, description.render.spp)
    print("program: kept" if is_kept(folder, *arguments) else "program: not kept, the first render compiles")
