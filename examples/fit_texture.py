"""Find the painting on a vase, 128x128 texels, from four pictures of it in a room.

    python examples/fit_texture.py

49,152 numbers: least squares would want a picture's derivative in each of them. A gradient costs the same however many
they are, and Adam goes down it, looking at one view after the other, each time by new samples. `gradient_key` gives the
derivative samples of its own; were they the picture's, the noise of both would be the same, and the loss would have its
square, of which a darker vase has less. The texels are the sigmoid of a pyramid, a sum of pictures of all sizes, so
that a step moves large areas as well as small ones.
"""

import time
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import optax
from figure import arguments, save_figure

import jaxrt
from jaxrt.textures.pyramid import joined, parted

options = arguments(__doc__)
(width, height), spp, steps, least = ((8, 12), 1, 4, 1e-3) if options.quick else ((128, 176), 1, 1000, 1)
NAME = "textures.majolica"
views = jaxrt.load_views("scenes/vase.toml")
views = [replace(view, camera=replace(view.camera, width=width, height=height)) for view in views]
truth = jaxrt.parameters(views[0])[NAME]
targets = [jaxrt.render(view, 10**6 + i, spp=1024 * spp) for i, view in enumerate(views)]


def texels(levels):
    """The sigmoid keeps a texel between 0 and 1."""
    return jax.nn.sigmoid(joined(levels))


def loss(levels, view, target, i):
    painted = jaxrt.with_parameters(view, {NAME: texels(levels)})
    return jnp.mean((jaxrt.render(painted, 2 * i, spp=spp, gradient_key=2 * i + 1) - target) ** 2)


@jax.jit
def step(levels, state, view, target, i):
    value, slopes = jax.value_and_grad(loss)(levels, view, target, i)
    moves, state = adam.update(slopes, state)
    return optax.apply_updates(levels, moves), state, value


@jax.jit
@jax.grad
def pixels(texture, view):
    """Return how many pixels show each texel: the derivative of the albedos that they show."""
    painted = jaxrt.with_parameters(view, {NAME: texture})
    return jnp.sum(jaxrt.render(painted, 0, spp=16, outputs=("albedo",))["albedo"][..., 0])


def told(found):
    """Return PSNR, in dB of linear colours, and mean error of the texels that are seen, in words."""
    off = np.asarray(found - truth, float)[visible]
    error = off.std() / off.size**0.5
    return f"{-10 * np.log10(np.mean(off**2)):.2f} dB, off by {off.mean():+.4f} ± {error:.4f} on average"


visible = np.asarray(sum(pixels(truth, view)[..., 0] for view in views)) >= least
levels = parted(jnp.zeros_like(truth))  # all grey, albedo 1/2
adam = optax.adam(optax.cosine_decay_schedule(0.05, steps, alpha=0.1))
state, losses = adam.init(levels), []
print(f"{visible.mean():.1%} of {visible.size} texels have {least} pixels or more; at the start {told(texels(levels))}")
for i in range(steps):
    if i == 1:
        begin = time.process_time()  # the first step compiles
    levels, state, value = step(levels, state, views[i % 4], targets[i % 4], np.uint32(i))
    losses.append(float(value))
    if (i + 1) % max(1, steps // 10) == 0 and i:
        print(f"{i + 1} renders and gradients, {time.process_time() - begin:.0f} s of CPU: {told(texels(levels))}")
curve = np.convolve(losses, np.ones(4) / 4, "valid")  # of all four views
save_figure(
    options.output / "fit_texture.png", truth, {"start": truth * 0 + 0.5, "fit": texels(levels)}, {"Adam": curve}
)
