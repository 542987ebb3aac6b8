"""How sure is a fit? Standard errors of a recovered light, checked against the scatter over seeds.

    python examples/uncertainty.py

Least squares knows its own uncertainty: a residual r moves the answer by (JᵀJ)⁻¹Jᵀ r. Were noise alike in all pixels,
the covariance would be σ²(JᵀJ)⁻¹. Path-traced noise is not: it is large on shadow edges, which place the light, so the
residual of each pixel stands for its own noise, (JᵀJ)⁻¹Jᵀ S J(JᵀJ)⁻¹ (White 1980), S = rrᵀ within a pixel: its three
channels share their samples.
"""

import jax
import jax.numpy as jnp
from figure import arguments
from matplotlib.figure import Figure

import jaxrt

options = arguments(__doc__)
spp, seeds = (4, 4) if options.quick else (16, 64)
scene = jaxrt.load_scene("scenes/ball_on_floor.toml")
edges = 4 * scene.camera.width * scene.camera.height
truth = jaxrt.parameters(scene)["lights.position"].ravel()
target = jaxrt.render(scene, 10**6, spp=64 * spp)


@jax.jit
def gauss_newton(position, key):
    """Return the next position, and its standard errors by the two formulas."""

    def residual(position):
        lit = jaxrt.with_parameters(scene, {"lights.position": position[None, :]})
        r = (jaxrt.render(lit, key, spp=spp, boundary_samples=edges) - target).ravel()
        return r, r

    jacobian, r = jax.jacfwd(residual, has_aux=True)(position)
    inverse = jnp.linalg.pinv(jacobian)
    pooled = jnp.sqrt(jnp.mean(r**2) * jnp.sum(inverse**2, axis=1))
    sandwich = jnp.sqrt(jnp.sum((inverse * r).reshape(3, -1, 3).sum(axis=2) ** 2, axis=1))
    return position - inverse @ r, pooled, sandwich


def fit(key):
    position = truth + 0.05
    for _ in range(4):
        position, pooled, sandwich = gauss_newton(position, key)
    return position, pooled, sandwich


found, pooled, sandwich = (jnp.stack(column) for column in zip(*map(fit, range(seeds)), strict=True))
scatter = found.std(axis=0, ddof=1)
print(f"mean of {seeds} fits {found.mean(axis=0)}, truth {truth}")
print(f"scatter over seeds       {scatter}")
for name, errors in {"σ²(JᵀJ)⁻¹": pooled, "sandwich": sandwich}.items():
    typical = jnp.sqrt(jnp.mean(errors**2, axis=0))
    print(f"standard error, {name:10} {typical}, of the scatter {typical / scatter}")

figure = Figure(figsize=(9, 2.8), layout="constrained")
for i, axes in enumerate(figure.subplots(1, 3)):
    axes.errorbar(range(seeds), found[:, i], yerr=sandwich[:, i], fmt=".", linewidth=0.7)
    axes.axhline(truth[i], color="k", linewidth=0.8)
    axes.set(xlabel="seed", title=f"light {'xyz'[i]} with its standard error")
figure.savefig(options.output / "uncertainty.png", dpi=75)
print(f"figure: {options.output / 'uncertainty.png'}")
