"""Moving visibility edges as JAX sees them: a picture of zeros that has their derivative."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero

from jaxrt import boundary
from jaxrt.scene import Scene
from jaxrt.transport.outputs import channels


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def moving_edges(scene: Scene, seed: Array, plan: boundary.Plan) -> Array:
    """Return zeros (height, width, channels), whose derivative is what moving visibility edges add to the picture's.

    seed: () uint32. What moves is read off the derivative that is asked for, whatever `plan` says of it: edges are not
    sampled unless they move. Raises ValueError where a second derivative is taken.
    """
    return jnp.zeros((scene.camera.height, scene.camera.width, channels(plan.outputs)), scene.dtype)


@partial(moving_edges.defjvp, symbolic_zeros=True)
def _moving_edges_jvp(plan: boundary.Plan, primals: tuple[Scene, Array], tangents: Any) -> tuple[Array, Array]:
    scene, seed = primals
    nothing = moving_edges(scene, seed, plan)
    changes, structure = jax.tree.flatten(tangents[0], is_leaf=lambda x: isinstance(x, SymbolicZero))
    names = [
        jax.tree_util.keystr(path, simple=True, separator=".")
        for (path, _), change in zip(jax.tree.leaves_with_path(scene), changes, strict=True)
        if not isinstance(change, SymbolicZero)
    ]
    parts = [name.split(".") for name in names]
    lights_move = any(part[0] == "lights" and part[-1] in {"position", "radius"} for part in parts)
    # What bends light moves all that is seen through it
    bending = () if plan.outputs else scene.materials.bends
    bends = any(part[0] == "materials" and tuple(part[1:]) in bending for part in parts)
    geometry_moves = bends or any(part[0] in {"camera", "spheres", "triangles"} for part in parts)
    if not (lights_move or geometry_moves):
        return nothing, jnp.zeros_like(nothing)
    plan = plan._replace(lights_move=lights_move, geometry_moves=geometry_moves)
    dense = [_dense(change) for change in changes]
    return nothing, boundary.edge_tangent(_once(scene), jax.tree.unflatten(structure, dense), seed, plan)


def _dense(change: Any) -> Any:
    """Return a tangent as `jax.jvp` wants it: float0 zeros for integers."""
    if not isinstance(change, SymbolicZero):
        return change
    inexact = jnp.issubdtype(change.dtype, jnp.inexact)
    return jnp.zeros(change.shape, change.dtype) if inexact else np.zeros(change.shape, jax.dtypes.float0)


@jax.custom_jvp
def _once(scene: Scene) -> Scene:
    """Return the scene, of which no further derivative can be taken."""
    return scene


@partial(_once.defjvp, symbolic_zeros=True)
def _once_jvp(primals: tuple[Scene], tangents: Any) -> Any:
    raise ValueError(
        "render: boundary_samples: the edge terms have no second derivative; use boundary_samples=0 for the Hessian "
        "of the interior terms, or Gauss-Newton, which needs first derivatives only"
    )
