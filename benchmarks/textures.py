"""Textures: what one costs in a picture, and one recovered from four pictures of a room, beside Mitsuba.

    python -m benchmarks.textures [--cost] [--fit] [--rounds 5] [--peer-python PATH]

Cost: a mesh, or the walls of a room, with a picture of 128x128 texels on it, a checker, or colours at its vertices,
beside the same in one colour: ratios of CPU time a camera path in alternating pairs of one process.

Fit: the 128x128 texels of a vase, painted in one of two ways, from four views, by least squares as in
examples/fit_texture.py, told after each round; and by 1,000 steps of Adam on the texels, each by one sample a
pixel in one of the views, beside Mitsuba's on gradients of path replay (prb), with `--more` as many again at the last
rate. Each looks for what its own pictures show, Adam at some rates, of which a star has the least loss; PSNR is that of
texels that have a pixel or more. CPU seconds are of all threads, without what compiles.
"""

import argparse
import sys
import tempfile
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.table import Table

import jaxrt
from benchmarks.interleave import Picture, interleaved, picture, ratios, spread
from benchmarks.ladder import count
from benchmarks.processes import HERE, cpu_model, find_peer, flags, report_of, run_child, wide_console
from benchmarks.texture_task import TOLD

SCENE = "scenes/vase.toml"
RATES = (0.01, 0.02, 0.05)  # of Adam
KINDS = ("squares", "adam", "mitsuba")
PAINTINGS = ("majolica", "wood")  # what the vase may be painted with
TEXELS = 128
SIZE, SPP, DEPTH = 96, 16, 3
TEXTURES: dict[str, dict[str, Any]] = {
    "image": {"texels": np.random.default_rng(0).uniform(0.2, 0.8, (128, 128, 3))},
    "checker": {"type": "checker"},
    "vertex_colors": {"type": "vertex_colors"},
}
PLAIN = [0.5, 0.5, 0.5]


def thing(file: str) -> dict[str, Any]:
    """Return a mesh of a file, about 2 high and about its middle, with places on a picture around it, and colours."""
    mesh = jaxrt.load_mesh(file)
    low, high = mesh["vertices"].min(0), mesh["vertices"].max(0)
    places = (mesh["vertices"] - (low + high) / 2) * (2 / (high - low)[1])
    uv = np.stack([np.arctan2(places[:, 0], places[:, 2]) / (2 * np.pi) + 0.5, places[:, 1] / 2 + 0.5], -1)
    return {"vertices": places, "faces": mesh["faces"], "uv": uv, "colors": np.full((len(uv), 3), 0.5)}


def room(mesh: dict[str, Any], part: str, texture: str | None) -> dict[str, Any]:
    """Return a mesh, the thing, within walls, another mesh. part: which of both has the texture, if there is one."""
    corners = np.array([[x, y, z] for x in (-3, 3) for y in (-1, 2) for z in (-3, 3)])
    quads = [[0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5], [0, 2, 3, 1], [4, 5, 7, 6]]
    walls = {
        "vertices": corners[np.ravel(quads)],
        "faces": [[4 * i + a, 4 * i + b, 4 * i + c] for i in range(6) for a, b, c in ((0, 2, 1), (0, 3, 2))],
        "uv": [[0, 0], [1, 0], [1, 1], [0, 1]] * 6,
        "colors": np.full((24, 3), 0.5),
    }
    albedos: dict[str, Any] = {"thing": PLAIN, "walls": PLAIN}
    if texture:
        albedos[part] = "paint"
    return {
        "camera": {"position": [0, 0.6, 2.8], "target": [0, 0, 0], "fov": 50, "width": SIZE, "height": SIZE},
        "textures": {"paint": TEXTURES[texture]} if texture else {},
        "materials": {name: {"type": "diffuse", "albedo": albedo} for name, albedo in albedos.items()},
        "meshes": [{**mesh, "material": "thing"}, {**walls, "material": "walls"}],
        "lights": [{"position": [1.5, 1.5, 1.5], "intensity": 6, "radius": 0.2}],
    }


def costs(rounds: int, sorts: list[str]) -> Table:
    """Return what each sort of texture costs on each mesh."""
    table = Table(title=f"{SIZE}x{SIZE}, {SPP} spp, depth {DEPTH}, {rounds} rounds")
    for column in ("what is painted", "faces", "texture", "µs a path", "in those without (range)", "equations more"):
        table.add_column(column)
    plain: dict[str, Picture] = {}
    for name, part in (("mug", "thing"), ("mug", "walls"), ("cat", "thing")):
        mesh = thing(f"scenes/{name}.obj")
        drawn: dict[str | None, Picture] = {s: picture(built(mesh, part, s), SPP, DEPTH) for s in sorts}
        drawn = {None: plain.get(name) or picture(built(mesh, part, None), SPP, DEPTH), **drawn}
        plain[name] = drawn[None]
        times = interleaved({str(sort): one.again for sort, one in drawn.items()}, rounds)
        for sort, one in drawn.items():
            micro = spread([1e6 * t / one.paths for t in times[str(sort)]]).told()
            row = [part if part == "walls" else name, str(len(mesh["faces"])), sort or "none", micro]
            if sort:
                more = count(one.program.traced) - count(drawn[None].program.traced)
                row += [spread(ratios(times, sort, "None")).told(".3f"), str(more)]
            table.add_row(*row)
    return table


def built(mesh: dict[str, Any], part: str, texture: str | None) -> jaxrt.Scene:
    """Return the scene; that it does not use all that meshes have is as it should be."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        return jaxrt.build(room(mesh, part, texture))


def visible() -> Any:
    """Return which texels (rows, columns) have a pixel or more in all views together."""
    views = jaxrt.load_views(SCENE)
    name = next(name for name in jaxrt.parameters(views[0]) if name.startswith("textures."))

    @jax.jit
    @jax.grad
    def pixels(texture: Any, view: jaxrt.Scene) -> Any:
        painted = jaxrt.with_parameters(view, {name: texture})
        return jnp.sum(jaxrt.render(painted, 0, spp=16, outputs=("albedo",))["albedo"][..., 0])

    return sum(np.asarray(pixels(jaxrt.parameters(view)[name], view))[..., 0] for view in views) >= 1


def fits(python: str | None, painting: str, options: argparse.Namespace, folder: str) -> list[Table]:
    """Return the PSNR along the way of each contender, and what it took: of least squares, and of Adam."""
    files = {"visible": visible(), "texels": texels_of(painting)}
    for name, values in files.items():
        np.save(f"{folder}/{name}.npy", values)
    command = [SCENE, f"{folder}/visible.npy", *flags(steps=options.steps, more=options.more)]
    command += [*flags(texels=f"{folder}/texels.npy"), "--rates", *map(str, options.rates)]
    ours = [sys.executable, "-m", "benchmarks.jaxrt_textures", *command]
    squares = Table(title=f"{SCENE}, {painting}: least squares")
    for column in ("round", "gradients", "renders", "of one sample a pixel: PSNR, dB", "CPU s", "wall s"):
        squares.add_column(column)
    if "squares" in options.kinds:
        for i, report in enumerate(report_of(run_child(ours, folder))["fits"][0]["rounds"]):
            counts = str(report["gradients"]), str(report["renders"])
            squares.add_row(str(i + 1), *counts, *(f"{report[key]:.1f}" for key in ("psnr", "cpu", "wall")))
    descents = Table(title=f"{SCENE}, {painting}: Adam, a gradient of one sample a pixel a step")
    tenths = [*range(options.steps // TOLD, options.steps + 1, options.steps // TOLD)]
    tenths += [options.steps + options.more] * (options.more > 0)
    for column in ("PSNR, dB, after", "rate", *map(str, tenths), "CPU s", "wall s"):
        descents.add_column(column)
    halves = {"jaxrt": [*ours, "--plain"]} if "adam" in options.kinds else {}
    if python and "mitsuba" in options.kinds:
        halves["Mitsuba"] = [python, str(HERE / "mitsuba_textures.py"), *command]
    for name, half in halves.items():
        reports = report_of(run_child(half, folder))["fits"]
        best = min(report["loss"] for report in reports)
        for report in reports:
            row = [f"{report['rate']:g}{' *' * (report['loss'] == best)}", *(f"{x:.1f}" for x in report["psnr"])]
            descents.add_row(name, *row, f"{report['cpu']:.0f}", f"{report['wall']:.0f}")
    return [table for table in (squares, descents) if table.rows]


def texels_of(painting: str) -> Any:
    """Return the linear texels of a picture among the scenes, shrunk to those of the vase."""
    texels = np.asarray(jaxrt.load_texture(f"scenes/{painting}.png")["texels"], float)
    share = len(texels) // TEXELS
    return texels.reshape(TEXELS, share, TEXELS, share, 3).mean((1, 3))


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cost", action="store_true", help="what textures cost alone")
    parser.add_argument("--fit", action="store_true", help="the recovery alone")
    parser.add_argument("--sorts", nargs="+", choices=TEXTURES, default=list(TEXTURES))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of fits")
    parser.add_argument("--rates", nargs="+", type=float, default=list(RATES), help="of Adam")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--more", type=int, default=0, help="steps after these, at the last one's rate")
    parser.add_argument("--paintings", nargs="+", choices=PAINTINGS, default=list(PAINTINGS))
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    options, console = parser.parse_args(), wide_console()
    console.print(cpu_model())
    if options.cost or not options.fit:
        console.print(costs(options.rounds, options.sorts))
    if options.fit or not options.cost:
        python, message = find_peer(options.peer_python)
        console.print(message)
        with tempfile.TemporaryDirectory() as folder:
            for painting in options.paintings:
                console.print(*fits(python, painting, options, folder))


if __name__ == "__main__":
    main()
