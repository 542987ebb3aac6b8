"""Derivatives inside of edges: closed forms, every transformation of JAX, random numbers, memory and kernels.

Compilation is what costs here, so one small scene serves them all. Seeds are fixed: a test passes always or never.
"""

from functools import cache, partial

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from benchmarks.ladder import count
from jaxrt.kernels.gather import take
from jaxrt.transport import interior
from jaxrt.transport.shine import pull_light

ONE = tuple(jax.devices()[:1])
unoptimised = pytest.mark.usefixtures("quick_compilation")

# Closed forms: a point light in a closed diffuse ball

INSIDE = {
    "camera": {"position": [0.3, 0.1, 0.2], "target": [1, 0.4, -0.2], "width": 8, "height": 8, "fov": 100},
    "materials": {"wall": {"type": "diffuse", "albedo": [0.2, 0.8, 1.0]}},
    "spheres": [{"center": [0, 0, 0], "radius": 2, "material": "wall"}],
    "lights": [{"position": [0, 0, 0], "intensity": 5}],
}
CHOSEN = ("lights.position", "lights.intensity", "materials.albedo", "spheres.radius")
SPP = 16


@cache
def ball():
    return jaxrt.build(INSIDE)


def chosen(**changes):
    """Return the ball's parameters, changed: `lights_position` stands for lights.position."""
    values = {name: jaxrt.parameters(ball())[name] for name in CHOSEN}
    return values | {name.replace("_", "."): jnp.asarray(v, jnp.float32) for name, v in changes.items()}


def ball_picture(values, key=0, depth=2, **options):
    return jaxrt.render(
        jaxrt.with_parameters(ball(), values), key, **({"spp": SPP, "max_depth": depth, "devices": ONE} | options)
    )


@cache
def ball_program(depth, spp=SPP):
    """Return the compiled (picture, pull-back of its sum) of (parameters, key)."""

    def both(values, key):
        image, pull = jax.vjp(lambda values: ball_picture(values, key, depth, spp=spp), values)
        return image, pull(jnp.ones_like(image))[0]

    return jax.jit(both).lower(chosen(), jnp.uint32(0)).compile()


@unoptimised
@pytest.mark.parametrize("rho", [(0.2, 0.8, 1.0), (0.0, 0.1, 0.35), (0.5, 0.65, 0.9)])
@pytest.mark.parametrize("depth", [1, 8])
def test_closed_ball_with_its_light_at_the_centre(depth, rho):
    """L = I/(πr²) Σ ρ^k in every sample, so its derivatives in ρ, I and r are exact in every sample too, to 1e-5.

    Nine albedos pin the polynomials of depth 8, and with them every order of indirect light up to it.
    """
    _, pulled = ball_program(depth)(chosen(materials_albedo=[rho]), jnp.uint32(depth))
    rho, intensity, radius, pixels = np.array(rho), 5.0, 2.0, 64
    k = np.arange(1, depth + 1)[:, None]
    unit = pixels / (np.pi * radius**2)
    series = np.sum(rho**k, 0)
    np.testing.assert_allclose(
        pulled["materials.albedo"][0], intensity * unit * np.sum(k * rho ** (k - 1), 0), rtol=1e-5
    )
    np.testing.assert_allclose(pulled["lights.intensity"][0], unit * series, rtol=1e-5)
    np.testing.assert_allclose(pulled["spheres.radius"][0], -2 / radius * intensity * unit * series.sum(), rtol=1e-4)


@unoptimised
def test_light_moved_inside_a_closed_ball():
    """Its indirect light is the same at every place: derivative 0, within 4σ of 32 seeds; direct light's is not."""
    values = chosen(lights_position=[[0.8, -0.3, 0.4]])

    def moments(depth):
        program = ball_program(depth)
        return np.array([program(values, jnp.uint32(k))[1]["lights.position"][0] for k in range(32)], float)

    direct = moments(1)
    indirect = moments(4) - direct
    error = indirect.std(0, ddof=1) / np.sqrt(32)
    assert np.all(abs(indirect.mean(0)) < 4 * error)
    assert np.all(error < 0.05 * np.linalg.norm(direct.mean(0)))
    assert np.linalg.norm(direct.mean(0)) > 1


@unoptimised
def test_the_sampled_interior_is_differentiated_exactly():
    """Without edges, and with the picture's own key, the derivative is that of the very samples drawn.

    Central differences of float32 pictures with the same random numbers, h = 0.01: rounding/h + h², 2e-3 in all.
    """
    values = chosen(lights_position=[[0.8, -0.3, 0.4]])
    draw = jax.jit(ball_picture)
    pulled = ball_program(2)(values, jnp.uint32(5))[1]
    for name, value in values.items():
        for index in np.ndindex(value.shape):
            if name == "materials.albedo" and index[1] == 2:  # at 1, beyond which nothing is
                continue
            step = jnp.zeros_like(value).at[index].set(0.01)
            ahead, behind = (draw(values | {name: value + s * step}, jnp.uint32(5)) for s in (1, -1))
            slope = np.sum(np.asarray(ahead, float) - np.asarray(behind, float)) / 0.02
            np.testing.assert_allclose(pulled[name][index], slope, rtol=2e-3, atol=2e-3 * abs(slope) + 2e-3)


# Every transformation


@cache
def slopes():
    """Return the Jacobian (8, 8, 3, …) of a picture in the ball, from `jacfwd`."""
    return jax.jit(jax.jacfwd(ball_picture))(chosen())


@unoptimised
@pytest.mark.quick
def test_jvp_and_grad_and_jacrev_agree_with_jacfwd():
    """To 1e-5 of the largest entry: the same samples, summed in another order."""
    values = chosen()
    jacobian = {k: np.asarray(v, float) for k, v in slopes().items()}
    v = {k: jnp.asarray(np.random.default_rng(2).normal(size=x.shape), x.dtype) for k, x in values.items()}
    change = jax.jit(lambda x, dx: jax.jvp(ball_picture, (x,), (dx,))[1])(values, v)
    expected = sum(np.tensordot(jacobian[k], np.asarray(v[k], float), values[k].ndim) for k in values)
    np.testing.assert_allclose(change, expected, atol=1e-5 * abs(expected).max())
    rows = jax.jit(jax.jacrev(lambda x: ball_picture(x)[2, 3:5]))(values)
    gradient = jax.jit(jax.grad(lambda x: ball_picture(x).sum()))(values)
    for k in values:
        scale = 1e-5 * abs(jacobian[k]).max()
        np.testing.assert_allclose(rows[k], jacobian[k][2, 3:5], atol=scale)
        np.testing.assert_allclose(gradient[k], jacobian[k].sum((0, 1, 2)), atol=192 * scale)


SHINING = {
    "camera": {"position": [0, 1, 5], "target": [0, 0.5, 0], "width": 8, "height": 8, "fov": 40},
    "environment": {"radiance": [0.2, 0.1, 0.3]},
    "materials": {
        "floor": {"type": "diffuse", "albedo": [0.2, 0.8, 0.9]},
        "mirror": {"type": "mirror", "albedo": [0.9, 0.7, 0.8]},
        "metal": {"type": "conductor", "albedo": [0.9, 0.8, 0.6], "roughness": 0.3},
        "tinted": {"type": "glass", "ior": 1.3, "absorption": [0.5, 0.2, 0.1]},
    },
    "spheres": [
        {"center": [0, -50, 0], "radius": 50, "material": "floor"},
        {"center": [0.5, 0.6, 0], "radius": 0.6, "material": "mirror"},
        {"center": [-0.7, 0.5, 0], "radius": 0.5, "material": "metal"},
        {"center": [0, 0.4, 2], "radius": 0.4, "material": "tinted"},
    ],
    "lights": [
        {"position": [1, 3, 2], "intensity": [9, 8, 7], "radius": 0.5},
        {"position": [-2, 2, 1], "intensity": [3, 4, 5], "radius": 0.2},
    ],
}
SHINES = ("lights.position", "lights.radius", "lights.intensity", "environment.radiance")


@unoptimised
@pytest.mark.quick
def test_what_shines_is_pulled_back_as_it_is_pushed_forward(monkeypatch):
    """Lights and sky have a pass of their own backwards: <w, J v> = <Jᵀ w, v> of each, to the rounding of sums, 1e-5.

    With what paths see of them by light samples, in a mirror, on metal, through tinted glass and by their last rays.
    """
    taken = []
    monkeypatch.setattr(interior, "pull_light", lambda *a: taken.append(a) or pull_light(*a))
    scene = jaxrt.build(SHINING)
    start, random = {name: jaxrt.parameters(scene)[name] for name in SHINES}, np.random.default_rng(3)
    along = {k: jnp.asarray(random.uniform(0.5, 1, x.shape), x.dtype) for k, x in start.items()}
    weights = jnp.asarray(random.uniform(0.5, 1, (8, 8, 3)), jnp.float32)

    def picture(values):
        return jaxrt.render(jaxrt.with_parameters(scene, values), 1, spp=4, max_depth=3, devices=ONE)

    @jax.jit
    def pushed(number):
        directions = {one: jnp.where(i == number, along[one], 0) for i, one in enumerate(SHINES)}
        return jnp.vdot(weights, jax.jvp(picture, (start,), (directions,))[1])

    pulled = jax.jit(jax.grad(lambda values: jnp.vdot(weights, picture(values))))(start)
    for i, name in enumerate(SHINES):
        change = float(pushed(i))
        assert abs(change) > 1e-2
        assert float(jnp.vdot(pulled[name], along[name])) == pytest.approx(change, rel=1e-5, abs=1e-5), name
    assert taken


@unoptimised
@pytest.mark.quick
def test_vmap_of_pictures_and_of_gradients():
    """Equal to one after the other, to 1e-6; of twenty scenes, which is more than a native kernel has room for."""
    places = jnp.asarray(np.linspace([[0.8, -0.3, 0.4]], [[-0.5, 0.2, 0.1]], 20), jnp.float32)
    own = chosen()

    def loss(place):
        return jnp.sum(ball_picture(own | {"lights.position": place}) ** 2)

    losses, gradients = jax.jit(jax.vmap(jax.value_and_grad(loss)))(places)
    single = jax.jit(jax.value_and_grad(loss))
    for place, value, gradient in zip(places, losses, gradients, strict=True):
        one, slope = single(place)
        np.testing.assert_allclose(value, one, rtol=1e-6)
        np.testing.assert_allclose(gradient, slope, rtol=1e-5, atol=1e-5 * abs(slope).max())


@unoptimised
def test_devices_do_not_matter():
    """Gradients on two devices are those on one, to the rounding of their sums, 1e-6."""
    assert len(jax.devices()) == 2
    gradient = jax.jit(jax.grad(lambda x: ball_picture(x, devices=jax.devices()).sum()))(chosen())
    for name, value in ball_program(2)(chosen(), jnp.uint32(0))[1].items():
        np.testing.assert_allclose(gradient[name], value, rtol=1e-6, atol=1e-5)


@unoptimised
def test_wide_packets_backwards_add_up_to_the_same_gradient(monkeypatch):
    """Gradients of as many numbers as a large mesh has are drawn in wider packets than the picture."""
    monkeypatch.setattr(interior, "LARGE", 0)
    # Another tile than that of `ball_program`, since JAX keeps traces
    run = jax.jit(jax.grad(lambda values: jnp.sum(ball_picture(values, depth=1, tile=(4, 4)))))
    program = run.lower(chosen())
    assert "tensor<1x1024x3xf32>" in program.as_text()  # weights of the packets
    wide, narrow = program.compile()(chosen()), ball_program(1)(chosen(), jnp.uint32(0))[1]
    for name in CHOSEN:
        np.testing.assert_allclose(wide[name], narrow[name], rtol=1e-5, atol=1e-6, err_msg=name)


@unoptimised
@pytest.mark.quick
def test_hessian_of_the_interior():
    """Direct light ρ I cosθ/(π d²) under a light inside a ball has a closed form, and so has its Hessian: 1e-4."""
    eye, seen, rho, intensity = np.array([0.3, 0.1, 0.2]), np.array([1.2, 0, -1.6]), 0.8, 5.0
    meter = jaxrt.build(
        INSIDE | {"camera": {"position": eye, "target": seen, "width": 2, "height": 1, "fov": 1e-3}},
    )

    def measured(place):
        scene = jaxrt.with_parameters(meter, {"lights.position": place[None]})
        return jaxrt.render(scene, 0, spp=1, max_depth=1, devices=ONE)[0, :, 1].mean()

    def formula(place):
        toward = place - jnp.asarray(seen, jnp.float32)
        squared = toward @ toward
        cosine = toward @ jnp.asarray(-seen / 2, jnp.float32) / jnp.sqrt(squared)
        return rho / np.pi * intensity * cosine / squared

    place = jnp.asarray([0.8, -0.3, 0.4], jnp.float32)
    np.testing.assert_allclose(measured(place), formula(place), rtol=1e-4)
    expected = jax.jit(jax.hessian(formula))(place)
    found = jax.jit(jax.hessian(measured))(place)
    np.testing.assert_allclose(found, expected, atol=2e-4 * abs(expected).max())


@pytest.mark.quick
def test_second_derivatives_of_edges_are_refused():
    def loss(place):
        values = chosen() | {"lights.position": place}
        return ball_picture(values, boundary_samples=64).sum()

    with pytest.raises(ValueError, match="boundary_samples: the edge terms have no second derivative"):
        jax.eval_shape(jax.hessian(loss), chosen()["lights.position"])


@pytest.mark.quick
def test_edges_cost_nothing_where_what_changes_moves_none():
    """The sky's radiance is a leaf of the scene, others are leaves of its parts."""
    scene = jaxrt.build(INSIDE | {"environment": {"radiance": [0.3, 0.2, 0.1]}})

    def added(name):
        """Return how many equations boundary samples add to a gradient's program."""

        def loss(value, samples):
            moved = jaxrt.with_parameters(scene, {name: value})
            return jaxrt.render(moved, 0, spp=1, max_depth=2, boundary_samples=samples, devices=ONE).sum()

        value = jaxrt.parameters(scene)[name]
        without, with_edges = (
            count(jax.make_jaxpr(jax.grad(partial(loss, samples=samples)))(value)) for samples in (0, 64)
        )
        return with_edges - without

    found = {added(name) for name in ("environment.radiance", "materials.albedo", "lights.intensity")}
    assert len(found) == 1 and found.pop() < 10
    assert added("lights.position") > 100 and added("camera.position") > 100


# Random numbers of derivatives


@unoptimised
def test_gradient_key_and_gradient_spp():
    """The picture keeps its own samples; the derivative is that of the other key's picture, to 1e-6."""
    values = chosen(lights_position=[[0.8, -0.3, 0.4]])

    @jax.jit
    def both(values, key, gradient_key):
        draw = partial(ball_picture, spp=4, gradient_key=gradient_key, gradient_spp=SPP)
        image, pull = jax.vjp(lambda values: draw(values, key), values)
        return image, pull(jnp.ones_like(image))[0]

    image, pulled = both(values, jnp.uint32(1), jnp.uint32(2))
    again, other = both(values, jnp.uint32(1), jnp.uint32(3))
    np.testing.assert_array_equal(image, again)
    _, expected = ball_program(2)(values, jnp.uint32(2))
    for name in CHOSEN:
        np.testing.assert_allclose(pulled[name], expected[name], rtol=1e-5, atol=1e-5)
    assert abs(other["lights.position"] - pulled["lights.position"]).max() > 1e-3
    with pytest.raises(ValueError, match="gradient_spp is 0, want at least 1"):
        ball_picture(values, gradient_spp=0)


@unoptimised
def test_samples_in_parts():
    """Parts of a picture's samples have its mean, in the picture and, by another key's samples, in the derivative."""
    values = chosen(lights_position=[[0.8, -0.3, 0.4]])

    @jax.jit
    def part(values, first):
        draw = partial(ball_picture, key=1, spp=SPP // 2, samples=(first, SPP), gradient_key=2)
        image, pull = jax.vjp(draw, values)
        return image, pull(jnp.ones_like(image))[0]

    parts = [part(values, jnp.uint32(first)) for first in (0, SPP // 2)]
    image, pulled = jax.tree.map(lambda a, b: (a + b) / 2, *parts)
    (wanted, _), (_, expected) = (ball_program(2)(values, jnp.uint32(key)) for key in (1, 2))
    np.testing.assert_allclose(image, wanted, rtol=1e-5, atol=1e-6)
    for name in CHOSEN:
        np.testing.assert_allclose(pulled[name], expected[name], rtol=1e-5, atol=1e-5)
    assert np.abs(parts[0][0] - parts[1][0]).max() > 1e-3


# What it costs


def temporary(depth, spp=SPP):
    return ball_program(depth, spp).memory_analysis().temp_size_in_bytes


STATE = 16 * 8 * (4 * (6 + 3 + 3) + 1)  # bytes of a packet's paths: ray, throughput, radiance and a flag a lane


@unoptimised
def test_memory_does_not_grow_with_samples(figures):
    """Within 10 % from 16 to 1024 samples a pixel."""
    growth = temporary(2, 1024) / temporary(2)
    figures("X8", "memory of a gradient with 1024 samples, per that with 16", ours=growth, at_most=1.1)


@unoptimised
def test_memory_grows_by_one_path_a_bounce(figures):
    share = (temporary(8) - temporary(2)) / (6 * STATE)
    figures("X8", "packets of paths that an event leaves for the backward pass", ours=share, at_most=1)


def kernels(compiled):
    return compiled.as_text().count('xla_cpu_small_call="true"')


@unoptimised
@pytest.mark.quick
def test_derivatives_are_native_kernels_and_tangents_share_one():
    """Were the tag lost, derivatives would still be right, and ten times slower.

    A Jacobian of ten parameters has no more kernels than that of one.
    """
    assert kernels(ball_program(2)) > 10

    def along(n):
        def slopes(values):
            flat, restore = jax.flatten_util.ravel_pytree(values)
            basis = jnp.eye(n, flat.size, dtype=flat.dtype)
            return jax.vmap(lambda v: jax.jvp(ball_picture, (values,), (restore(v),))[1])(basis)

        return jax.jit(slopes).lower(chosen()).compile()

    assert kernels(along(10)) <= kernels(along(1))


def sum_of_rows(table, rows):
    return jax.jit(jax.grad(lambda table: take(table, rows).sum()))(table)


def test_gradients_of_reads_are_sums_over_rows():
    rows = jnp.asarray(np.random.default_rng(0).integers(0, 5, 40_000), jnp.int32)
    table = jnp.zeros((5, 3), jnp.float32)
    expected = np.repeat(np.bincount(rows, minlength=5)[:, None], 3, 1)
    np.testing.assert_array_equal(sum_of_rows(table, rows), expected)


def test_sums_of_gradients_go_on_past_two_to_the_24(figures):
    """A plain float32 sum of ones stops at 16 777 216; here it is exact to 1e-6 (case R2)."""
    assert np.float32(2**24) + np.float32(1) == np.float32(2**24)
    # A wall that fills the view, and the sky behind the camera: every sample is the wall's albedo
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 0], "width": 512, "height": 512, "fov": 20},
            "environment": {"radiance": [1, 1, 1]},
            "materials": {name: {"type": "diffuse", "albedo": [0.5, 0.6, 0.7]} for name in "ab"},
            "spheres": [{"center": [0, 0, z], "radius": 10, "material": m} for z, m in ((-20, "b"), (-80, "a"))],
        }
    )
    spp = 80

    @jax.jit
    def pulled(albedo):
        changed = jaxrt.with_parameters(scene, {"materials.albedo": albedo})
        return spp * jnp.sum(jaxrt.render(changed, 0, spp=spp, max_depth=1, devices=ONE)[..., 0])

    gradient = jax.grad(pulled)(jaxrt.parameters(scene)["materials.albedo"])
    samples = 512 * 512 * spp
    assert samples > 1.2 * 2**24
    np.testing.assert_allclose(gradient, [[0, 0, 0], [samples, 0, 0]], rtol=1e-6)
    bad, error = (abs(float(x) / samples - 1) for x in (2**24, gradient[1, 0]))
    figures("R2", "error of a gradient that sums 2.1e7 ones; naive: stops at 2²⁴", naive=bad, ours=error, at_most=1e-6)
