"""`jaxrt info`."""

import argparse

from jaxrt.checks import check_memory
from jaxrt.cli.start import built
from jaxrt.io.scene_file import read_description
from jaxrt.summary import print_summary


def run(args: argparse.Namespace) -> None:
    description = read_description(args.scene, args.allow_folder)
    check_memory(description.camera.width, description.camera.height, str(args.scene))
    messages: list[object] = []
    scene = built(description, messages.append)
    print_summary(str(args.scene), description, scene, [str(message) for message in messages])
