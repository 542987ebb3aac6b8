"""Cameras that are no plain pinhole: where their rays go, in closed form, and that their images are there."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.cameras import View, projection, view_of
from jaxrt.description.kinds import CAMERAS
from jaxrt.scene.parameters import asked

pytestmark = pytest.mark.usefixtures("quick_compilation")

PLACE = {"position": [1.0, 2, 3], "target": [0.2, 1, 0.5], "width": 24, "height": 16}
TURNED = {"roll": 10.0, "rotate": [3.0, -5, 8]}
BENT = {"k1": -0.2, "k2": 0.05, "p1": 0.01, "p2": -0.02, "k3": 0.01}
KINDS: dict[str, dict[str, Any]] = {
    "pinhole": {"fov": 50},
    "calibrated": {"fx": 20, "fy": 22, "cx": 11.5, "cy": 7.75, **BENT},
    "orthographic": {"tall": 4},
    "fisheye": {"angle": 190},
    "equirectangular": {},
    "thin_lens": {"fov": 50, "focus": 2.5, "aperture": 0.3},
}
IMAGES = [(8.2, 8.01), (3.2, 11.4), (20.6, 1.5), (12.4, 8.6)]
LENS = 0.3, 0.7


def camera_of(**table: Any) -> Any:
    checked = CAMERAS.validate(table)
    return CAMERAS.kind_of(checked).single(checked, jnp.float32)


def view_at(camera: Any) -> View:
    """Return a camera's view, through one place of its lens if it has one."""
    view = view_of(camera)
    return view if view.lens is None else view.through((jnp.float32(LENS[0]), jnp.float32(LENS[1])))


def scene_of(**camera: Any) -> jaxrt.Scene:
    return jaxrt.build({"camera": camera, "lights": [{"position": [0, 9, 0], "intensity": 1}]})


def pair(image: tuple[float, float]) -> tuple[jax.Array, jax.Array]:
    return jnp.float32(image[0]), jnp.float32(image[1])


def direction(camera: Any, image: tuple[float, float]) -> np.ndarray:
    return np.asarray(view_of(camera).ray(pair(image), pair(LENS)).direction, float)


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_point_is_where_its_ray_goes(kind: str) -> None:
    """`project` undoes `ray` at any values: so both have the same derivative in each of the camera's parameters."""
    camera = camera_of(type=kind, **PLACE, **TURNED, **KINDS[kind])
    values = {name: getattr(camera, name) for name in camera.kind.parameters}
    assert {"roll", "rotate", "position"} <= values.keys()

    def there_and_back(values: dict[str, jax.Array]) -> jax.Array:
        view = view_at(type(camera)(**{**vars(camera), **values}))
        ray = view.ray(pair(IMAGES[0]), pair(LENS))
        return jnp.stack(view.project(ray.origin + 3 * ray.direction)[0])

    back, pull = jax.vjp(there_and_back, values)
    np.testing.assert_allclose(back, IMAGES[0], atol=1e-4)
    for row in np.eye(2, dtype=np.float32):
        for name, slope in pull(jnp.asarray(row))[0].items():
            np.testing.assert_allclose(slope, 0, atol=1e-3, err_msg=name)
    view = view_at(camera)
    for image in IMAGES:
        ray = view.ray(pair(image), pair(LENS))
        point = ray.origin + 3 * ray.direction
        seen = projection(view, point)
        np.testing.assert_allclose(seen.image, image, atol=1e-4)
        assert seen.inside and seen.pixel == int(image[1]) * 24 + int(image[0])
        np.testing.assert_allclose(seen.density, View.density(view, point), rtol=1e-3)
        np.testing.assert_allclose(view.eye(point), ray.origin, atol=1e-5)
        reached = view.start(pair(image)) + view.depth(point) * view.toward(pair(image))
        np.testing.assert_allclose(reached, point, atol=2e-6)


def test_fisheye_angles() -> None:
    """The angle to the axis is the distance from the picture's middle times that of a pixel, on all sides."""
    camera = camera_of(type="fisheye", position=[0, 0, 0], angle=190, width=24, height=16)
    for x, y in [(12, 0), (12, 16), (4, 8), (20, 8), (18, 2), (1, 14)]:
        across, down = x - 12, y - 8
        distance, angle = np.hypot(across, down), np.radians(np.hypot(across, down) * 190 / 16)
        want = [np.sin(angle) * across / distance, -np.sin(angle) * down / distance, -np.cos(angle)]
        np.testing.assert_allclose(direction(camera, (x, y)), want, atol=1e-6)


def test_panorama_angles() -> None:
    """A column is a longitude, a row a latitude: the middle looks ahead, a quarter to the right is to the right."""
    camera = camera_of(type="equirectangular", position=[0, 0, 0], width=24, height=12)
    for image, want in {(12, 6): [0, 0, -1], (18, 6): [1, 0, 0], (0, 6): [0, 0, 1], (6, 6): [-1, 0, 0]}.items():
        np.testing.assert_allclose(direction(camera, image), want, atol=1e-6)
    np.testing.assert_allclose(direction(camera, (12, 2)), [0, np.sin(np.pi / 3), -np.cos(np.pi / 3)], atol=1e-6)


def test_orthographic_rays_are_parallel_and_their_starts_a_pixel_apart() -> None:
    view = view_of(camera_of(type="orthographic", position=[1, 2, 3], tall=4, width=24, height=16))
    starts = np.asarray([view.ray(pair(image), pair(LENS)).origin for image in [(12, 8), (13, 8), (12, 0)]])
    np.testing.assert_allclose(starts, [[1, 2, 3], [1.25, 2, 3], [1, 4, 3]], atol=1e-6)
    np.testing.assert_allclose(view.ray(pair((3, 3)), pair(LENS)).direction, [0, 0, -1])


def test_lens_rays_meet_in_focus_and_part_by_the_circle_of_confusion() -> None:
    """What is at depth z is a disk of diameter A |z − focus| / z in the plane in focus, A being that of the lens."""
    view = view_of(camera_of(type="thin_lens", position=[0, 0, 0], fov=60, focus=2, aperture=0.3, width=8, height=8))
    turns = np.linspace(0, 1, 9, dtype=np.float32)
    rays = [view.ray(pair((6, 3)), (jnp.float32(u), jnp.float32(0.99999994))) for u in turns]
    for depth in (2.0, 5.0, 0.5):
        places = np.asarray([ray.origin + ray.direction * (-depth / ray.direction[2]) for ray in rays], float)
        wide = np.linalg.norm(places - places[:8].mean(0), axis=-1) * 2
        np.testing.assert_allclose(wide, 0.3 * abs(depth - 2) / 2, atol=2e-6)  # of the cone, at that depth
    point = jnp.asarray([0.4, 0.3, -5.0])
    images = np.asarray([view.through((jnp.float32(u), jnp.float32(1))).project(point)[0] for u in turns[:8]])
    disk = (
        np.linalg.norm(images - images.mean(0), axis=-1) * 2 * (2 * np.tan(np.pi / 6) / 8) * 2
    )  # in the plane in focus
    np.testing.assert_allclose(disk, 0.3 * (5 - 2) / 5, rtol=1e-4)


def test_the_lens_blurs_a_picture() -> None:
    """A far small lamp is an even disk, by its variance R²/4 along an axis; in focus it is where it is."""
    camera = {"type": "thin_lens", "position": [0, 0, 0], "fov": 20, "aperture": 2, "width": 16, "height": 16}
    lamp = {"position": [0, 0, -20], "intensity": 1, "radius": 0.5}
    pixel = 2 * np.tan(np.radians(10)) / 16

    def picture(focus: float) -> np.ndarray:
        scene = jaxrt.build({"camera": {**camera, "focus": focus}, "lights": [lamp]})
        return np.asarray(jaxrt.render(scene, 0, spp=1024, max_depth=1), float)[..., 0]

    sharp, blurred = picture(20), picture(8)
    assert sharp[6:10, 6:10].sum() == pytest.approx(sharp.sum())
    assert sharp.sum() == pytest.approx(blurred.sum(), rel=0.05)
    axis = np.arange(16) - 7.5
    disk, own = (1 / 8 - 1 / 20) / pixel, 0.5 / 20 / pixel
    for along in (blurred.sum(0), blurred.sum(1)):
        assert 4 * (along @ axis**2) / along.sum() == pytest.approx(disk**2 + own**2 + 1 / 3, rel=0.05)


def test_roll_and_rotate() -> None:
    """A roll turns what is seen clockwise; `rotate` is about right, up and backwards, and 0 has a derivative."""
    ahead = {"type": "pinhole", "position": [0, 0, 0], "fov": 90, "width": 16, "height": 16}
    above = jnp.asarray([0, 0.5, -1.0])
    column, row = (float(x) for x in view_of(camera_of(**ahead, roll=90)).project(above)[0])
    assert (column, row) == pytest.approx((12, 8), abs=1e-4)
    same = [view_of(camera_of(**ahead, **turn)).project(above)[0] for turn in ({"roll": 20}, {"rotate": [0, 0, 20]})]
    np.testing.assert_allclose(*same, atol=1e-5)
    np.testing.assert_allclose(
        direction(camera_of(**ahead, rotate=[0, 30, 0]), (8, 8)), [-0.5, 0, -(0.75**0.5)], atol=1e-6
    )
    np.testing.assert_allclose(
        direction(camera_of(**ahead, rotate=[30, 0, 0]), (8, 8)), [0, 0.5, -(0.75**0.5)], atol=1e-6
    )

    def seen(rotate: jax.Array) -> jax.Array:
        camera = camera_of(**ahead, rotate=[0, 0, 0])
        return jnp.stack(view_of(type(camera)(**{**vars(camera), "rotate": rotate})).project(above)[0])

    slope = jax.jacfwd(seen)(jnp.zeros(3))
    step = 0.5 * np.eye(3)
    difference = np.stack([(seen(jnp.asarray(h)) - seen(jnp.asarray(-h))) for h in step], -1)
    np.testing.assert_allclose(slope, difference, atol=1e-3)
    assert np.isfinite(jax.jacfwd(jax.jacrev(seen))(jnp.zeros(3))).all()


K = np.array([[700.0, 0, 325.5], [0, 710, 236.25], [0, 0, 1]])
R, T = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]]), np.array([0.2, -0.3, 4.0])
POINTS = np.array([[0.1, 0.2, 0.3], [-0.7, 0.4, 0.1], [0.5, -0.6, -0.4], [0, 0, 0]])


def by_hand(points: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Return pixels (n, 2) as OpenCV's manual has them."""
    k1, k2, p1, p2, k3 = distortion
    x, y, z = (points @ R.T + T).T
    x, y = x / z, y / z
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    moved = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([K[0, 0] * moved[0] + K[0, 2], K[1, 1] * moved[1] + K[1, 2]], -1)


@pytest.mark.parametrize("distortion", [np.zeros(5), np.array([-0.3, 0.1, 0.002, -0.001, 0.02])])
def test_opencv_there_and_back(distortion: np.ndarray) -> None:
    """Points are where OpenCV projects them, half a pixel on, since it counts from pixels' middles; K comes back."""
    table = jaxrt.camera_from_opencv(K, R, T, distortion, 640, 480)
    assert (set(BENT) & table.keys()) == (set(BENT) if distortion.any() else set())
    view = view_of(camera_of(**table))
    images = np.asarray([jnp.stack(view.project(jnp.asarray(p, jnp.float32))[0]) for p in POINTS])
    np.testing.assert_allclose(images, by_hand(POINTS, distortion) + 0.5, atol=2e-3)
    for image, point in zip(images, POINTS, strict=True):
        ray = view.ray(pair(image), pair(LENS))
        away = point + R.T @ T
        np.testing.assert_allclose(ray.direction, away / np.linalg.norm(away), atol=3e-6)
    scene = scene_of(**table)
    back = jaxrt.camera_to_opencv(scene)
    for name, want in {"K": K, "R": R, "t": T, "distortion": distortion}.items():
        np.testing.assert_allclose(getattr(back, name), want, rtol=1e-6, atol=2e-6, err_msg=name)


def test_opencv_turns_pinholes_and_refusals() -> None:
    vector = np.array([0.3, -0.2, 0.5])
    table = jaxrt.camera_from_opencv(K, vector, T, corner=0)
    assert (table["width"], table["height"], table["cx"]) == (651, 472, 325.5)
    turned = jaxrt.camera_to_opencv(scene_of(**table), corner=0)
    angle = np.linalg.norm(vector)
    np.testing.assert_allclose(turned.R @ vector, vector, atol=1e-6)
    assert np.trace(turned.R) == pytest.approx(1 + 2 * np.cos(angle), abs=1e-6)
    found = jaxrt.camera_to_opencv(scene_of(**PLACE, fov=90))
    np.testing.assert_allclose(found.K, [[8, 0, 11.5], [0, 8, 7.5], [0, 0, 1]], atol=1e-5)
    with pytest.raises(jaxrt.SceneError, match="R: .* is no rotation"):
        jaxrt.camera_from_opencv(K, 2 * R, T)
    with pytest.raises(jaxrt.SceneError, match="K: .* has skew"):
        jaxrt.camera_from_opencv(K + [[0, 5, 0], [0, 0, 0], [0, 0, 0]], R, T)
    with pytest.raises(jaxrt.SceneError, match="distortion: .* has more than k1"):
        jaxrt.camera_from_opencv(K, R, T, [0.1, 0, 0, 0, 0, 0.2])
    assert jaxrt.camera_from_opencv(K, R, T, None) == jaxrt.camera_from_opencv(K, R, T)
    with pytest.raises(jaxrt.SceneError, match="distortion: .* is not finite: leave it out for none"):
        jaxrt.camera_from_opencv(K, R, T, [0.1, np.nan])
    with pytest.raises(jaxrt.SceneError, match="camera: is 'fisheye'"):
        jaxrt.camera_to_opencv(scene_of(type="fisheye", **PLACE))


def test_a_preview_shows_the_same() -> None:
    """K is told for pictures of `size`, whatever is drawn."""
    table = {"type": "calibrated", **PLACE, "fx": 20, "fy": 22, "k1": -0.1}
    whole, half = camera_of(**table), camera_of(**{**table, "width": 12, "height": 8, "size": [24, 16]})
    np.testing.assert_allclose(direction(whole, (20, 3)), direction(half, (10, 1.5)), atol=1e-6)
    assert camera_of(**table).cx == 12 and half.cx == 12


def test_what_is_not_asked_for_is_not_there() -> None:
    """Turns and coefficients are parameters where the file has them or a name asks; else they are no code."""
    scene = scene_of(type="calibrated", **PLACE, fx=20, fy=22)
    assert {"camera.cx", "camera.fx"} <= jaxrt.parameters(scene).keys()
    assert not {"camera.roll", "camera.k1"} & jaxrt.parameters(scene).keys()
    assert jaxrt.parameters(scene, "camera.k1") == 0
    changed = jaxrt.with_parameters(scene, {"camera.k1": 0.1, "camera.rotate": [1.0, 2, 3]})
    assert jaxrt.parameters(changed)["camera.k1"] == np.float32(0.1)
    np.testing.assert_array_equal(jaxrt.parameters(changed)["camera.rotate"], [1, 2, 3])
    assert asked(scene, ["camera.fx"]) is scene

    def count(scene: jaxrt.Scene) -> int:
        return str(jax.make_jaxpr(lambda camera: view_of(camera).ray(pair((3, 3)), pair(LENS)))(scene.camera)).count(
            " = "
        )

    assert count(scene) < count(jaxrt.with_parameters(scene, {"camera.roll": 1.0})) < count(changed)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"type": "fisheye", "angle": 300}, r"angle: 300: the corners .* use 199 or less"),
        ({"type": "fisheye", "angle": 0}, r"angle: 0(.0)? is not between 0 and 360"),
        ({"type": "calibrated", "fx": 3}, r'"fy" is missing: add fy = 1'),
        ({"type": "calibrated", "fx": 3, "fy": 3, "size": 4}, r"size: 4 is no pair"),
        ({"type": "thin_lens", "aperture": 0}, r"aperture: 0(.0)? is not > 0"),
        ({"type": "orthographic", "fov": 30}, r'unknown key "fov"'),
        ({"type": "pinhole", "rotate": 30}, r"rotate: 30(.0)? is not a list"),
    ],
)
def test_refusals(table: dict[str, Any], message: str) -> None:
    with pytest.raises(jaxrt.SceneError, match=message):
        scene_of(**PLACE, **table)


def test_a_distortion_that_folds_is_told() -> None:
    folded = {"type": "calibrated", **PLACE, "fx": 12, "fy": 12, "k1": -0.5}
    with pytest.warns(jaxrt.SceneWarning, match=r"distortion folds back 0\.54 focal lengths from the axis"):
        scene = scene_of(**folded)
    view = view_of(scene.camera)
    assert np.isfinite(np.asarray(view.ray(pair((0, 0)), pair(LENS)).direction)).all()
    # A point beyond the fold would be seen a second time
    beside = [view.position + 3 * view.forward + x * view.right for x in (1, 3)]
    assert view.project(beside[0])[1] and not view.project(beside[1])[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene_of(**{**folded, "k1": -0.05})
