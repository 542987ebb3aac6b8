"""The fitted scene: whatever a scene's parameters come from, they go back there."""

from pathlib import Path

import numpy as np
import pytest

import jaxrt
from jaxrt.fit import document, sought
from jaxrt.fit.document import write_scene
from jaxrt.io.scene_file import read_description

ROOT = Path(__file__).parent.parent
SCENES = [ROOT / "scenes" / name for name in ("room.toml", "seed/mesh_in_room.toml", "ball_under_sphere_light.toml")]
CAMERA = "[camera]\nposition = [0, 1, 6]\nwidth = 8\nheight = 8\n"
LIGHT = "[[lights]]\nposition = [2, 4, 3]\nintensity = 40\n"
GREY = '[materials.a]\ntype = "diffuse"\nalbedo = [0.5, 0.4, 0.3]\n'
TURNED = "rotate = [10, 20, 30]\nscale = 0.7\ntranslate = [0.1, 0.2, 0.3]\n"
TETRAHEDRON = """\
vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]  # mine
faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
"""
MADE = {
    "inline mesh": CAMERA + LIGHT + GREY + f'[[meshes]]\nmaterial = "a"\n{TURNED}{TETRAHEDRON}',
    "mesh file with materials": CAMERA + LIGHT + f'[[meshes]]\nfile = "two.obj"\n{TURNED}',
    "mesh, then triangle": CAMERA + LIGHT + GREY + f'[[meshes]]\nmaterial = "a"\n{TETRAHEDRON}'
    + '[[triangles]]\nvertices = [[-2, 0, 2], [2, 0, 2], [0, 2, -2]]\nmaterial = "a"\n',
    "inline tables": """\
camera = {position = [0, 1, 6], fov = 40}
lights = [{position = [2, 4, 3], intensity = 40}, {position = [2, 5, 3], intensity = [1, 2, 3], radius = 0.1}]
environment.radiance = [1, 2, 3]
materials = {a = {type = "diffuse", albedo = [0.5, 0.4, 0.3]}, m = {type = "mirror"}, o = {type = "glass", ior = 1.4}}
spheres = [{center = [0, 0, 0], radius = 1, material = "a"}, {center = [3, 0, 0], radius = 1, material = "m"}]
""",
    "far off": CAMERA.replace("[0, 1, 6]", "[600000, 1, 6]") + LIGHT.replace("[2, 4, 3]", "[600002, 4, 3]") + GREY
    + '[[spheres]]\ncenter = [600000, 1, 0]\nradius = 1\nmaterial = "a"\n',
}  # fmt: skip


def written_and_read(source: Path, folder: Path) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return new values of all parameters but those of large meshes, and what a fitted scene with them holds."""
    description = read_description(source)
    scene = jaxrt.load_scene(source)
    texts = [name for name, value in jaxrt.parameters(scene).items() if value.size < 100]
    unknowns = sought(scene, texts)
    vector = unknowns.vector(scene) + np.random.default_rng(0).uniform(-0.01, 0.01, len(unknowns.labels()))
    wanted = unknowns.values(vector.astype(np.float32))
    selectors = {row.text: row.selector for row in unknowns.rows}
    write_scene(source, folder / "fitted.toml", wanted, selectors, description)
    found = jaxrt.parameters(jaxrt.load_scene(folder / "fitted.toml", allow_folders=[source.parent, ROOT / "scenes"]))
    return wanted, {text: np.asarray(selector.pick(found[selector.name])) for text, selector in selectors.items()}


@pytest.mark.filterwarnings("ignore::jaxrt.SceneWarning")
@pytest.mark.parametrize("source", [*SCENES, *MADE], ids=lambda source: getattr(source, "stem", source))
def test_s7_every_parameter_of_every_scene_has_a_place(source: Path | str, tmp_path: Path) -> None:
    """Those of inline meshes, of mesh files and of the materials that they bring along too."""
    if isinstance(source, str):
        (tmp_path / "two.obj").write_text(
            "mtllib two.mtl\nusemtl red\nv -1 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 1\nf 1 2 3\nusemtl blue\nf 1 4 2\n"
        )
        (tmp_path / "two.mtl").write_text("newmtl red\nKd .7 .2 .1\nnewmtl blue\nKd .1 .2 .7\n")
        (tmp_path / "scene.toml").write_text(MADE[source])
        source = tmp_path / "scene.toml"
    (tmp_path / "out").mkdir()
    wanted, found = written_and_read(source, tmp_path / "out")
    assert wanted.keys() == found.keys() and len(wanted) > 4
    for text, value in wanted.items():
        np.testing.assert_allclose(found[text], value, rtol=2e-6, atol=2e-6, err_msg=text)


def test_a_vertex_of_a_large_mesh_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, "MOST_FACES", 1)
    (tmp_path / "two.obj").write_text("v -1 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\n")
    (tmp_path / "scene.toml").write_text(CAMERA + LIGHT + GREY + '[[meshes]]\nfile = "two.obj"\nmaterial = "a"\n')
    with pytest.raises(jaxrt.SceneError, match=r"meshes.vertices\[0\]: two.obj has 2 faces, too many to write"):
        written_and_read(tmp_path / "scene.toml", tmp_path)
