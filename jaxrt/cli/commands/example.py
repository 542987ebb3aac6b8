"""`jaxrt example`."""

import argparse
from pathlib import Path

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.places import check_file
from jaxrt.core.examples import about, copy_of, examples
from jaxrt.core.writing import write_whole


def run(args: argparse.Namespace) -> None:
    """List the scenes that come with jaxrt, or write one with its meshes and pictures."""
    if args.name is None:
        _list(args.output)
        return
    text, meshes = copy_of(args.name)
    output: Path = args.output or Path(f"{args.name}.toml")
    if output.suffix != ".toml" and not output.is_dir():
        raise UsageError(f"{output}: a scene file ends in .toml: name it {output.with_suffix('.toml')}")
    files = {output: text.encode()} | {output.with_name(mesh): data for mesh, data in meshes.items()}
    for path, data in files.items():
        check_file(path, f"{args.name}.toml")
        _check_same(path, data)
    for path, data in files.items():
        _write(path, data)
    beside = f" with {', '.join(meshes)} beside it" if meshes else ""
    print(f"{output}: written{beside}, draw it with `jaxrt render {output}`")


def _list(output: Path | None) -> None:
    if output is not None:
        raise UsageError(f"{output}: of which example? name it, as in jaxrt example room -o {output}")
    files = examples()
    width = max(map(len, files))
    for name, path in files.items():
        print(f"{name:{width}}  {about(path)}")
    print("\njaxrt example NAME writes NAME.toml")


def _check_same(path: Path, data: bytes) -> None:
    """Refuse to replace what somebody has changed: an example is there to be changed."""
    with refusing():
        if path.exists() and path.read_bytes() != data:
            raise UsageError(f"{path}: is there, and is not this example: choose another name with -o")


def _write(path: Path, data: bytes) -> None:
    write_whole(path, lambda file: file.write(data))
