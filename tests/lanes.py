"""Run a one-ray function on many rays as `render` does: vmap in a packet, packets in one native loop."""

from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxrt.kernels.native import map_packets


def lanes(f: Callable[..., Any], packet: int = 64) -> Callable[..., Any]:
    """Return f, written for one lane, as a jitted function of operands with a leading axis of any length n.

    The last packet is filled up with copies of lane 0. Results are NumPy arrays with leading axis n.
    """

    @jax.jit
    def run(operands: Any) -> Any:
        count = jax.tree.leaves(operands)[0].shape[0] // packet

        def one_packet(operands: Any, k: Any) -> Any:
            rows = jax.tree.map(
                partial(jax.lax.dynamic_slice_in_dim, start_index=k * packet, slice_size=packet), operands
            )
            return jax.vmap(f)(*rows)

        results = map_packets(one_packet, operands, jnp.arange(count, dtype=jnp.int32))
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), results)

    @wraps(f)
    def call(*operands: Any) -> Any:
        n = jax.tree.leaves(operands)[0].shape[0]
        filled = jax.tree.map(lambda x: np.concatenate([x, np.repeat(x[:1], -n % packet, 0)]), operands)
        return jax.tree.map(lambda x: np.asarray(x)[:n], run(filled))

    return call
