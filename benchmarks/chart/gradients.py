"""What is measured for the charts of derivatives: by the position of a point light that casts a hard shadow."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxrt
from benchmarks.chart.closed import light_derivative
from benchmarks.chart.measure import Metric, measure
from benchmarks.chart.references import cached, content_key
from benchmarks.chart.studies import Settings, Study
from benchmarks.chart.subjects import SHADOW, Draw, Drawn
from benchmarks.clock import cpu_seconds
from benchmarks.edge_tables import bumps
from benchmarks.samplers import Reference
from jaxrt import boundary
from jaxrt.boundary.tangent import moving_edges
from jaxrt.render import draw_sum, prepare

AXIS = 0
PEERS = ("path", "prb", "direct_projective", "prb_projective")  # Mitsuba's integrators
LONGEST = 1024  # samples a pixel


def derivatives(settings: Settings) -> dict[str, Study]:
    """Return the chart of the derivative picture and the one of its smooth functionals, from the same runs."""
    methods, silent = _methods(settings)
    metrics = {
        "derivatives-picture": _metric(settings, "picture", np.asarray),
        "derivatives-functionals": _metric(settings, "functionals", bumps),
    }
    references = {name: metric.reference for name, metric in metrics.items()}
    # The quadrature's error bound is no variance: it is not subtracted
    exact = [metric._replace(reference=Reference(metric.reference.image, 0.0)) for metric in metrics.values()]
    curves = measure(methods, settings.sweep.up_to(LONGEST), exact, settings.progress)
    bands = [np.sqrt(references[name].variance) / metric.scale for name, metric in metrics.items()]
    facts = {"peers without an answer": silent}
    return {name: Study(c, band, facts) for name, c, band in zip(metrics, curves, bands, strict=True)}


def _metric(settings: Settings, name: str, reduce: Callable[[np.ndarray], np.ndarray]) -> Metric:
    """Return the relative L2 distance of derivative pictures, reduced: 16 means weighted by Gaussians are `bumps`."""
    names = {"kind": "derivative", "of": name, "size": SHADOW.size, "axis": AXIS, "quadrature": settings.quadrature}
    key = content_key(SHADOW.contents(), names)
    reference = cached(
        settings.cache, key, lambda: light_derivative(SHADOW.path, SHADOW.size, AXIS, settings.quadrature, reduce)
    )
    return Metric(reference, float(np.sqrt((reference.image**2).mean())), reduce)


def _methods(settings: Settings) -> tuple[dict[str, Draw], dict[str, str]]:
    """Return all methods, and what those of Mitsuba say that give no derivative here."""
    scene = SHADOW.scene()
    methods = {"interior only": _forward(scene, 0)}
    methods |= {f"with {n:,} edge samples": _forward(scene, n) for n in settings.methods.edges}
    methods |= {f"finite differences, step {h}": _difference(scene, h) for h in settings.methods.steps}
    silent = {}
    for name in PEERS if settings.peer else ():
        assert settings.peer
        draw = settings.peer.method(SHADOW, integrator=name, axis=AXIS)
        try:
            draw(0, [1])
        except RuntimeError as error:
            silent[name] = str(error).removeprefix("Mitsuba: ")
        else:
            methods[f"Mitsuba {name}"] = draw
    return methods, silent


def _moved(scene: jaxrt.Scene, shift: Any) -> jaxrt.Scene:
    position = jaxrt.parameters(scene)["lights.position"]
    return jaxrt.with_parameters(scene, {"lights.position": position.at[0, AXIS].add(shift)})


def picture_of(scene: jaxrt.Scene, seed: jax.Array, spp: jax.Array, boundary_samples: int = 0) -> jax.Array:
    """Return the picture as `jaxrt.render` draws it. spp may change in one program."""
    plain, run, plan = prepare(scene, seed, 0, spp, spp)
    picture = draw_sum(plain, run, plan, run) / spp
    if boundary_samples == 0:
        return picture
    return picture + moving_edges(
        plain, run.seed, boundary.Plan(boundary_samples, plan.max_depth, False, False, plan.devices)
    )


def _each_length(program: Callable[[jax.Array, jax.Array], Any]) -> Draw:
    """Return the method that calls the compiled program(seed, spp) once for each length."""
    compiled = jax.jit(program)

    def draw(seed: int, lengths: Sequence[int]) -> Drawn:
        drawn = {}
        for spp in lengths:
            image, seconds = cpu_seconds(compiled, jnp.uint32(seed), jnp.int32(spp))
            drawn[spp] = np.asarray(image, np.float64), seconds
        return drawn

    return draw


def _forward(scene: jaxrt.Scene, boundary_samples: int) -> Draw:
    """Return the forward derivative of `jaxrt.render`."""

    def slope(seed: jax.Array, spp: jax.Array) -> Any:
        def picture(shift: jax.Array) -> jax.Array:
            return picture_of(_moved(scene, shift), seed, spp, boundary_samples)

        return jax.jvp(picture, (jnp.zeros(()),), (jnp.ones(()),))[1]

    return _each_length(slope)


def _difference(scene: jaxrt.Scene, step: float) -> Draw:
    """Return the central difference of two pictures drawn with the same random numbers."""

    def difference(seed: jax.Array, spp: jax.Array) -> Any:
        above, below = (picture_of(_moved(scene, jnp.float32(shift)), seed, spp) for shift in (step, -step))
        return (above - below) / (2 * step)

    return _each_length(difference)
