"""What edges must leave as it was: the picture, and the programs of derivatives that move nothing of the kind."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich.console import Console
from rich.table import Table

import jaxrt
from benchmarks.edge_scenes import SCENES, rows
from benchmarks.ladder import build, count

SAMPLES = 1024
COUNTED_WITH = "0.10.1"  # the JAX that wrote these equations
NOTHING = 4  # equations of a picture of zeros that is added
# What edge samples add to the equations of an L2 loss with its gradient: (scene, parameter) -> how many
ADDED = {
    ("ball over floor", "materials.albedo"): NOTHING,
    ("ball over floor", "environment.radiance"): NOTHING,
    ("box beside a lamp", "lights.intensity"): NOTHING,
    ("mirror ball", "materials.albedo"): NOTHING,
    ("glass ball", "materials.albedo"): NOTHING,
    # Shadows alone
    ("half-sunk ball", "lights.position"): 5431,
    ("two boxes", "lights.position"): 4136,
}


def depth_of(name: str) -> int:
    """Return how many events the rows of a scene follow."""
    return max(row.depth for row in rows() if row.scene == name)


def equations(name: str, parameter: str, samples: int = SAMPLES) -> int:
    """Return how many equations a loss with its gradient has."""
    scene = build(SCENES[name], width=8, height=8)

    def loss(value: Array) -> Array:
        moved = jaxrt.with_parameters(scene, {parameter: value})
        return jnp.mean(jaxrt.render(moved, 0, spp=4, max_depth=depth_of(name), boundary_samples=samples) ** 2)

    return count(jax.make_jaxpr(jax.value_and_grad(loss))(jaxrt.parameters(scene, parameter)))


def same_picture(name: str) -> bool:
    """Return whether the picture is the same to the bit, with edge samples and without."""
    scene = build(SCENES[name], width=16, height=16)
    plain, edges = (
        np.asarray(jaxrt.render(scene, 1, spp=4, max_depth=depth_of(name), boundary_samples=n)) for n in (0, SAMPLES)
    )
    return np.array_equal(plain, edges)


def holds(console: Console) -> bool:
    """Print both, and return whether all is as it was."""
    changed = [name for name in SCENES if not same_picture(name)]
    console.print(f"pictures changed by edge samples: {', '.join(changed) or 'none'} of {len(SCENES)}")
    table = Table("gradient of", "in", "equations", "of edges", "as stored")
    found = {}
    for (name, parameter), stored in ADDED.items():
        plain = equations(name, parameter, 0)
        found[name, parameter] = equations(name, parameter) - plain
        table.add_row(parameter, name, str(plain), str(found[name, parameter]), str(stored))
    console.print(table)
    if jax.__version__ != COUNTED_WITH:
        console.print(f"equations are stored for jax {COUNTED_WITH}: not compared")
        return not changed
    return not changed and found == ADDED
