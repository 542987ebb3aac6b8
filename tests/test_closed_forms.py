"""Pictures whose radiance is known in closed form, through the public API.

Most cameras are radiance meters: an angle of view of 0.001° shows one point in all 64 pixels. Each pixel has
random numbers of its own, so one picture is 64 independent estimates, and their spread gives the standard
error. Seeds are fixed: a test passes always or never. "4σ" of 64 estimates fails for 1.7e-4 of random seeds.
"""

import jax
import numpy as np
import pytest

import jaxrt

QUICK = pytest.mark.usefixtures("quick_compilation")
GREY = [0.5, 0.5, 0.5]
METER = {"width": 8, "height": 8, "fov": 1e-3}


def shot(scene, key=0, spp=1, max_depth=1, sampler="sobol", unroll=False):
    """Return the picture (8, 8, 3) in float64. One device: its program compiles fastest."""
    one = jax.devices()[:1]
    image = jaxrt.render(scene, key, spp=spp, max_depth=max_depth, sampler=sampler, unroll=unroll, devices=one)
    return np.asarray(image, np.float64)


def estimate(image):
    """Return (mean, standard error) of the first channel of a meter's picture."""
    x = image[..., 0]
    return x.mean(), x.std(ddof=1) / np.sqrt(x.size)


def closed_ball(albedo, light=(0, 0, 0), radius=1.0, intensity=np.pi, eye=(0.3, 0.1, 0.2), target=(1, 0.4, -0.2)):
    """A diffuse sphere about the origin with a point light and the camera inside."""
    camera = {"position": eye, "target": target, "width": 8, "height": 8, "fov": 100}
    return jaxrt.build(
        {
            "camera": camera,
            "materials": {"wall": {"type": "diffuse", "albedo": albedo}},
            "spheres": [{"center": [0, 0, 0], "radius": radius, "material": "wall"}],
            "lights": [{"position": light, "intensity": intensity}],
        }
    )


def large_triangle(z, up=True, material="floor", size=50.0):
    """A triangle about (0, 0, z) whose normal is +z, or −z where not `up`."""
    corners = [[-size, -size, z], [size, -size, z], [0, 2 * size, z]]
    return {"vertices": corners if up else corners[::-1], "material": material}


# Every depth, every sampler, both programs; not every triple, since each costs a compilation
SERIES = [
    *(
        (depth, sampler, False)
        for sampler, depths in {"sobol": (1, 8), "stratified": (2, 5, 7), "independent": (3, 6)}.items()
        for depth in depths
    ),
    (2, "sobol", True),
    (1, "stratified", True),
    (1, "independent", True),
]


def check_light_at_the_centre(depth, sampler, unroll):
    """L = I/(πr²) Σ ρ^k, k = 1 … D: every path carries the same radiance, so one sample is exact."""
    albedo, radius, intensity = np.array([0.2, 0.8, 1.0]), 2.0, 5.0
    scene = closed_ball(albedo, radius=radius, intensity=intensity)
    image = shot(scene, key=depth, max_depth=depth, sampler=sampler, unroll=unroll)
    series = sum(albedo**k for k in range(1, depth + 1)) * intensity / (np.pi * radius**2)
    np.testing.assert_allclose(image, np.broadcast_to(series, image.shape), rtol=1e-5)
    # One event too many or too few would show
    assert abs(albedo[1] ** (depth + 1)) > 1e-2 * series[1]


def test_light_at_the_centre_of_a_closed_ball_by_an_optimised_program():
    check_light_at_the_centre(4, "sobol", False)


@QUICK
@pytest.mark.parametrize(("depth", "sampler", "unroll"), SERIES)
def test_light_at_the_centre_of_a_closed_ball(depth, sampler, unroll):
    check_light_at_the_centre(depth, sampler, unroll)


EYE, SEEN = np.array([0.3, 0.1, 0.2]), np.array([0.8, 0.0, -0.6])


def off_centre(light):
    scene = closed_ball([0.7, 0.7, 0.7], light, eye=EYE.tolist(), target=SEEN.tolist())
    return jaxrt.with_parameters(scene, {"camera.fov": 1e-3})


@QUICK
@pytest.mark.parametrize("light", [(0.5, 0.0, 0.0), (0.0, -0.6, 0.3), (-0.2, 0.1, 0.8)])
def test_light_off_the_centre_of_a_closed_ball(light):
    """Direct light ρ/π I cosθ/d², to 1e-4 (the meter's angle); indirect light the same at every place, within
    4σ.
    """
    toward = np.array(light) - SEEN
    direct = 0.7 * (toward @ -SEEN) / np.linalg.norm(toward) ** 3
    np.testing.assert_allclose(shot(off_centre(light)), direct, rtol=1e-4)
    mean, error = estimate(shot(off_centre(light), key=1, spp=1024, max_depth=4) - direct)
    indirect = 0.7**2 + 0.7**3 + 0.7**4
    assert abs(mean - indirect) < 4 * error + 1e-4 * direct
    assert error < 5e-3 * indirect


def sphere_light_over_floor(light, radius, intensity=3.0):
    """A meter on the origin of a floor of albedo .5."""
    return jaxrt.build(
        {
            "camera": {"position": [10, 0, 1], "target": [0, 0, 0], "up": [0, 0, 1], **METER},
            "materials": {"floor": {"type": "diffuse", "albedo": GREY}},
            "triangles": [large_triangle(0)],
            "lights": [{"position": light, "intensity": intensity, "radius": radius}],
        }
    )


@QUICK
@pytest.mark.parametrize("light", [(0, 0, 1), (1, 0.5, 1), (-3, 1, 0.7), (0, 2, 5)])
def test_sphere_light_above_the_horizon_is_a_point_light(light):
    """E = I cosθ/d² for any radius that leaves the light above the floor: within 4σ, and σ < 1e-3."""
    d = np.linalg.norm(light)
    for radius in (0.01, 0.3, 0.69):
        mean, error = estimate(shot(sphere_light_over_floor(light, radius), spp=256))
        want = 0.5 / np.pi * 3 * light[2] / d**3
        assert abs(mean - want) < 4 * error + 1e-5 * want
        assert error < 1e-3 * want


@QUICK
def test_white_furnace_around_a_ball():
    """A convex ball of albedo ρ in a constant environment L has radiance ρL in every sample."""
    albedo, sky = np.array([0.0, 0.3, 1.0]), np.array([2.0, 3.0, 4.0])
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 3], "width": 16, "height": 16, "fov": 60},
            "environment": {"radiance": sky},
            "materials": {"ball": {"type": "diffuse", "albedo": albedo}},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "ball"}],
        }
    )
    for key in (1, 2):
        image = shot(scene, key, max_depth=2)
        ball = np.isclose(image[..., 0], 0)
        np.testing.assert_allclose(image[ball], np.broadcast_to(albedo * sky, (ball.sum(), 3)), rtol=1e-6, atol=0)
        np.testing.assert_array_equal(image[~ball], np.broadcast_to(sky, ((~ball).sum(), 3)))
        # The limb is at sin θ = 1/3: a disc of 4.9 pixels radius, give or take the jitter
        assert np.pi * 4.2**2 < ball.sum() < np.pi * 5.6**2


def glass_over_floor(center, ior):
    scene = jaxrt.build(
        {
            "camera": {"position": [4, 0, 4], "target": [0, 0, 0], "up": [0, 0, 1], "width": 8, "height": 8},
            "materials": {
                "floor": {"type": "diffuse", "albedo": GREY},
                "glass": {"type": "glass", "ior": ior},
            },
            "spheres": [{"center": center, "radius": 1, "material": "glass"}],
            "triangles": [large_triangle(0)],
            "lights": [{"position": [-3, 0, 4], "intensity": 20, "radius": 0.5}],
        }
    )
    return jaxrt.with_parameters(scene, {"camera.fov": 20.0})


@QUICK
def test_glass_of_index_one_vanishes():
    """|z| < 4.9 of each pixel's difference, 16 seeds each: 1 % false alarms of 64 with 30 degrees of freedom.

    The glass hides the floor from the camera, not from the light. With an index of 1.5 the picture differs.
    """

    def pictures(center, ior, first):
        scene = glass_over_floor(center, ior)
        return np.stack([shot(scene, key, spp=64, max_depth=3)[..., 0] for key in range(first, first + 16)])

    def z(a, b):
        return (a.mean(0) - b.mean(0)) / np.sqrt((a.var(0, ddof=1) + b.var(0, ddof=1)) / 16)

    without = pictures([8, 0, 8], 1.0, 0)
    assert abs(z(pictures([2.5, 0, 2.5], 1.0, 100), without)).max() < 4.9
    assert abs(z(pictures([2.5, 0, 2.5], 1.5, 200), without)).max() > 50


def mirror_and_ball(eye, target, mirror_at):
    return jaxrt.build(
        {
            "camera": {"position": eye, "target": target, "up": [0, 1, 0], **METER},
            "materials": {
                "ball": {"type": "diffuse", "albedo": GREY},
                "mirror": {"type": "mirror", "albedo": [0.9, 0.5, 1.0]},
            },
            "spheres": [{"center": [0, 0, 3], "radius": 1, "material": "ball"}],
            "triangles": [large_triangle(mirror_at, material="mirror")],
            "lights": [{"position": [4, 3, 1], "intensity": 10}],
        }
    )


@QUICK
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.2, 0.4, 0.3), (0.6, -0.2, -0.1)])
def test_mirror_shows_the_mirrored_scene(offset):
    """What a meter sees in the mirror z = 0, its mirror image sees without a mirror, times the albedo: to
    1e-4.
    """
    flip = np.array([1, 1, -1])
    eye, point = np.array([4.0, 1.0, 3.0]), np.array([0, 0, 3.0]) + offset
    in_mirror = shot(mirror_and_ball(eye, point * flip, 0), max_depth=2)
    direct = shot(mirror_and_ball(eye * flip, point, -20), max_depth=2)
    assert direct.min() > 0.01
    np.testing.assert_allclose(in_mirror.mean((0, 1)), direct.mean((0, 1)) * [0.9, 0.5, 1.0], rtol=1e-4)


@QUICK
@pytest.mark.parametrize("ior", [1.0, 1.5, 3.0, 0.5])
def test_lossless_slab(ior):
    """T = (1−F)/(1+F), within 4σ and what six events leave out: F⁶ at most.

    The environment is seen through the slab only, since a black wall behind the camera takes what comes back.
    """
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 1], "target": [0, 0, 0], **METER},
            "environment": {"radiance": [1, 1, 1]},
            "materials": {
                "floor": {"type": "diffuse", "albedo": [0, 0, 0]},
                "glass": {"type": "glass", "ior": ior},
            },
            "triangles": [
                large_triangle(0, True, "glass"),
                large_triangle(-0.3, False, "glass"),
                large_triangle(2, False),
            ],
        }
    )
    share = ((ior - 1) / (ior + 1)) ** 2
    mean, error = estimate(shot(scene, spp=1024, max_depth=6))
    transmittance = (1 - share) / (1 + share)
    assert abs(mean - transmittance) < 4 * error + share**6 + 1e-5
    # A single passage through both faces is another number
    if share > 0:
        assert abs(mean - (1 - share) ** 2) > 4 * error
