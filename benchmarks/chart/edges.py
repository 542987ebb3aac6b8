"""What is measured for the chart of moving edges: the noise of derivatives at equal time, in scenes unlike one another.

All methods are held against the finite differences of `benchmarks.edges`, by the same nine functionals. A line is a
fixed number of boundary samples for so many samples a pixel: a call has 4 boundary samples a pixel, and more of both
are means of calls with seeds of their own. So no line levels off but where a term is missing.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxrt
from benchmarks.chart.curves import Curves
from benchmarks.chart.gradients import picture_of
from benchmarks.chart.measure import Metric, Sweep, measure
from benchmarks.chart.peer import Peer
from benchmarks.chart.studies import Settings, Study, nothing_kept
from benchmarks.chart.subjects import Draw, Drawn, Subject
from benchmarks.clock import cpu_seconds
from benchmarks.edge_peer import text_of
from benchmarks.edge_rows import Reference, References, bumps, noise_of, truncation
from benchmarks.edge_scenes import SCENES, Description, Row, direction, rows
from benchmarks.ladder import build
from benchmarks.samplers import Reference as Mean

SAMPLES, INSIDE_SPP = 4, 16  # boundary samples a pixel of a call; samples a pixel of one without
WITHOUT = "without edges"
# Of a call, by its edge samples for each 16 samples of a pixel
SPP = {"with 1 edge sample to 16 spp": 64, "with 4 edge samples to 16 spp": 16, "with 16 edge samples to 16 spp": 4}
PEER_SPP = 16  # of Mitsuba's shortest call, and as many of each kind of edge: as its tests take them
# Samples a pixel that guide these: its default. Its tests' 4,096 take six times as long, for as much noise
GUIDING = 512
LONG = Sweep(short=(1,), long=(4, 16), seeds=8, few=4)  # calls
PEER = Sweep(short=(1, 16, 64), long=(), seeds=4, few=4)  # in its shortest calls
BRIEF = Sweep(short=(1,), long=(), seeds=2, few=2)


class Panel(NamedTuple):
    """A scene of the chart."""

    title: str
    row: str  # of `benchmarks.edges`; of one about indirect light, the whole picture
    moved: str  # Mitsuba's name of what moves

    @property
    def of(self) -> Row:
        """Return the derivative."""
        (row,) = (row for row in rows() if row.name == self.row)
        return row._replace(name=self.title, less=0)


PANELS = (
    Panel("ball under a sky", "ball over floor, sky, depth 1, sideways", "sphere_0"),
    Panel("half-sunk ball", "half-sunk ball, x", "sphere_0"),
    Panel("box beside a lamp", "box, sky .1 beside a lamp, x", "mesh_0"),
    Panel("indirect light", "ball in a corner, indirect part, depth 3, x", "sphere_0"),
    Panel("mirror ball", "mirror ball, ball x", "sphere_1"),
    Panel("glass ball", "glass ball, ball x", "sphere_1"),
)


def edges(settings: Settings) -> Study:
    """Return the curves of all scenes, each method's name behind its scene's."""
    curves: Curves = {}
    facts: dict[str, Any] = {"floors": {}, "steps": {}, "compile": {}, "silent": {}}
    for panel in PANELS[: settings.methods.panels]:
        found = _panel(settings, panel, facts)
        curves |= {f"{panel.title}: {name}": points for name, points in found.items()}
    return Study(curves, max(facts["floors"].values()), facts)


def _panel(settings: Settings, panel: Panel, facts: dict[str, Any]) -> Curves:
    """Return the curves of a scene; what there is to say besides goes to the facts."""
    row = panel.of._replace(fd_spp=settings.methods.fd_spp or panel.of.fd_spp)
    settings.cache.mkdir(parents=True, exist_ok=True)
    reference = References(settings.cache / "edges.npz", settings.methods.fd_keys).of(row)
    metric = _metric(reference)
    facts["floors"][panel.title] = float(np.sqrt(metric.reference.variance)) / metric.scale
    size = float(np.linalg.norm(metric.reference.image))
    facts["steps"][panel.title] = truncation(bumps(reference.near), bumps(reference.wide))[0] / size
    inside, edged = (_compiled(row, n) for n in (0, SAMPLES))
    facts["compile"][panel.title] = {WITHOUT: inside.seconds, "with edges": edged.seconds}
    methods = {WITHOUT: _calls(inside.call, INSIDE_SPP)}
    methods |= {name: _calls(edged.call, spp) for name, spp in SPP.items()}
    brief = settings.sweep.seeds <= BRIEF.seeds
    (curves,) = measure(methods, BRIEF if brief else LONG, [metric], settings.progress)
    if settings.peer:
        with TemporaryDirectory() as folder:
            theirs, facts["silent"][panel.title] = _theirs(settings.peer, panel, row, Path(folder))
            (found,) = measure(theirs, BRIEF if brief else PEER, [metric], settings.progress)
            curves |= found
    return curves


def _metric(reference: Reference) -> Metric:
    """Return the relative L2 distance from finite differences by nine smooth functionals, less the noise of these."""
    near = bumps(reference.near)
    mean = near.mean(0)
    return Metric(Mean(mean, noise_of(near) ** 2 / mean.size), float(np.sqrt((mean**2).mean())), bumps)


class Compiled(NamedTuple):
    """A program (seed, spp) -> derivative picture."""

    call: Callable[[jax.Array, jax.Array], jax.Array]
    seconds: float  # CPU time to trace and compile


def _described(row: Row) -> Description:
    """Return the row's scene file."""
    scene = SCENES[row.scene]
    camera = scene["camera"] | {"width": row.size, "height": row.size}
    return scene | {"camera": camera, "render": {"max_depth": row.depth}}


def _compiled(row: Row, samples: int) -> Compiled:
    """Return the forward derivative, with so many boundary samples a pixel."""
    scene = build(_described(row))
    start, along = jaxrt.parameters(scene, row.parameter), direction(row, scene)

    @jax.jit
    def slope(seed: jax.Array, spp: jax.Array) -> jax.Array:
        def picture(shift: jax.Array) -> jax.Array:
            moved = jaxrt.with_parameters(scene, {row.parameter: start + shift * along})
            return picture_of(moved, seed, spp, samples * row.size**2)

        return jax.jvp(picture, (jnp.zeros(()),), (jnp.ones(()),))[1]

    with nothing_kept():
        begun = time.process_time()
        program = slope.lower(jnp.uint32(0), jnp.int32(1)).compile()
        return Compiled(program, time.process_time() - begun)


def _calls(program: Callable[..., jax.Array], spp: int) -> Draw:
    """Return the method whose lengths are calls, each of so many samples a pixel: it means them as they come."""

    def draw(seed: int, lengths: Sequence[int]) -> Drawn:
        drawn, total, spent = {}, np.zeros(()), 0.0
        for call in range(1, lengths[-1] + 1):
            # Lengths that are drawn apart share no seed
            own = jnp.uint32((64 * seed + lengths[0]) * 64 + call)
            picture, seconds = cpu_seconds(program, own, jnp.int32(spp))
            total, spent = total + np.asarray(picture, np.float64), spent + seconds
            if call in lengths:
                drawn[call * spp] = total / call, spent
        return drawn

    return draw


def _theirs(peer: Peer, panel: Panel, row: Row, folder: Path) -> tuple[dict[str, Draw], dict[str, str]]:
    """Return Mitsuba's method, a call for each length; or what it says that has no answer."""
    path = folder / "scene.toml"
    path.write_text(text_of(_tables(_described(row))))
    subject = Subject(panel.title, str(path), size=row.size)
    # Both answer direct light alike, and the one for it takes less time
    name = "prb_projective" if row.depth > 1 else "direct_projective"
    own = peer.method(
        subject, integrator=name, moved=[panel.moved], motion="translate", max_depth=row.depth, guiding=GUIDING
    )

    def draw(seed: int, lengths: Sequence[int]) -> Drawn:
        return own(seed, [PEER_SPP * n for n in lengths])

    try:
        draw(0, [1])
    except RuntimeError as error:
        return {}, {name: str(error).removeprefix("Mitsuba: ")}
    return {f"Mitsuba {name}": draw}, {}


def _tables(description: Description) -> list[tuple[str, Description]]:
    """Return the tables of a scene file, with their heads."""
    tables: list[tuple[str, Description]] = []
    for name, value in description.items():
        if isinstance(value, list):
            tables += [(f"[[{name}]]", each) for each in value]
        elif name == "materials":
            tables += [(f"[materials.{each}]", table) for each, table in value.items()]
        else:
            tables.append((f"[{name}]", value))
    return tables
