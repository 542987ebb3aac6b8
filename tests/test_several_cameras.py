"""Scene files with several cameras, and one fit of what all of them see."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.cli import main
from jaxrt.fit.views import tall

BALL = {
    "camera": dict(position=[0, 0, 4], width=8, height=8),
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.6, 0.4]}},
    "spheres": [{"center": [0.2, 0, 0], "radius": 1, "material": "white"}],
    "environment": {"radiance": [0.2, 0.3, 0.4]},
}

VIEWS = """
[[cameras]]
position = [0, 0, 4]
width = 48
height = 16
[[cameras]]
position = [4, 0, 0]
target = [0, 0, 0]
width = 24
height = 24
[materials.white]
type = "diffuse"
albedo = [0.8, 0.8, 0.8]
[[spheres]]
center = [0.2, 0, 0]
radius = 1
material = "white"
[[lights]]
position = [2, 3, 4]
intensity = 30
"""


def test_a_file_may_have_several_cameras(tmp_path):
    (tmp_path / "views.toml").write_text(VIEWS)
    first, second = jaxrt.load_views(tmp_path / "views.toml")
    assert (first.camera.width, second.camera.width) == (48, 24)
    assert second.spheres is first.spheres and second.camera.position.tolist() == [4, 0, 0]
    assert jaxrt.load_scene(tmp_path / "views.toml").camera.width == 48
    for text, words in (
        (VIEWS + "[camera]\nposition = [0, 0, 4]\n", "write that as the first of [[cameras]]"),
        (VIEWS.replace("position = [4, 0, 0]", 'position = "x"'), "cameras[1].position"),
        ("cameras = []\n" + VIEWS[VIEWS.index("[materials") :], "cameras: is no list of cameras"),
    ):
        (tmp_path / "bad.toml").write_text(text)
        with pytest.raises(jaxrt.SceneError, match=words.replace("[", r"\[").replace("]", r"\]")):
            jaxrt.load_views(tmp_path / "bad.toml")


TWO = """
[render]
spp = 16
max_depth = 1
[materials.left]
type = "diffuse"
albedo = [0.3, 0.3, 0.3]
[materials.right]
type = "diffuse"
albedo = [0.3, 0.3, 0.3]
[[spheres]]
center = [-20, 0, 0]
radius = 1
material = "left"
[[spheres]]
center = [20, 0, 0]
radius = 1
material = "right"
[[lights]]
position = [0, 0, 300]
intensity = 90000
"""
CAMERA = "[[cameras]]\nposition = [{x}, 0, 4]\nfov = 40\nwidth = 8\nheight = 8\n"


def test_one_fit_explains_pictures_of_several_cameras(tmp_path, monkeypatch, capsys):
    """Each camera sees one of two balls: only both pictures together tell both colours."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jaxrt.cli.start.start_jax", lambda cores: None)
    text = CAMERA.format(x=-20) + CAMERA.format(x=20) + TWO
    (tmp_path / "guess.toml").write_text(text)
    truth = jnp.asarray([[0.7, 0.2, 0.1], [0.1, 0.6, 0.5]])
    for i, view in enumerate(jaxrt.load_views("guess.toml")):
        seen = jaxrt.render(jaxrt.with_parameters(view, {"materials.albedo": truth}), 9, spp=64)
        jaxrt.save_image(f"view{i}.exr", seen)
    sought = ["--parameters", "materials.albedo", "--max-steps", "12", "-o", "out"]
    assert main(["fit", "guess.toml", "view0.exr", "view1.exr", *sought]) == 0, capsys.readouterr().err
    fitted = jaxrt.load_views("out/fitted.toml")
    assert len(fitted) == 2
    np.testing.assert_allclose(jaxrt.parameters(fitted[1], "materials.albedo"), truth, atol=0.01)
    assert main(["fit", "guess.toml", "view0.exr", *sought]) == 2
    assert "cameras: 2, for 1 pictures" in capsys.readouterr().err


def test_views_of_different_sizes_and_scenes():
    pictures = [jnp.ones((2, 3, 3)), 2 * jnp.ones((1, 5, 3))]
    stacked = tall(pictures)
    assert stacked.shape == (3, 5, 3) and stacked[:2, 3:].sum() == 0 and stacked[2].min() == 2
    scenes = [jaxrt.build(BALL), jaxrt.build(BALL | {"environment": {"radiance": [1, 1, 1]}})]
    blank = np.ones((8, 8, 3))
    with pytest.raises(jaxrt.SceneError, match="views of one scene differ in their cameras alone"):
        jaxrt.fit(scenes, [blank, blank], ["materials.albedo"])
    with pytest.raises(jaxrt.SceneError, match="2 scenes want a list of as many"):
        jaxrt.fit(scenes, [blank], ["materials.albedo"])
    moved = jaxrt.with_parameters(scenes[0], {"camera.fov": 50.0})
    with pytest.raises(jaxrt.SceneError, match=r"camera.fov: cameras differ in it"):
        jaxrt.fit([scenes[0], moved], [blank, blank], ["camera.fov"])
