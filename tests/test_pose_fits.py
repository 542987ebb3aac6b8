"""Fits of poses: things are placed before they are turned."""

import jax.numpy as jnp
import numpy as np

import jaxrt
from jaxrt.fit import Machine, Problem, sought
from jaxrt.fit.descent import STAGES
from jaxrt.fit.solve import Drawing

FLAT = {"vertices": [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "material": "red"}
SCENE = {
    "camera": {"position": [0, 0, 3], "target": [0, 0, 0], "width": 4, "height": 4},
    "materials": {"red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]}},
    "groups": {"pair": {}},
    "meshes": [FLAT | {"name": "flat"}, FLAT | {"translate": [0, 0, -1], "group": "pair"}],
    "lights": [{"position": [1, 1, 3], "intensity": 30}],
}


def test_turns_wait_until_places_are_found():
    """Those of what is placed too, in the first, most blurred stage: there any turn explains a little of a place."""
    names = ["meshes.rotate[flat]", "meshes.translate[flat]", "groups.rotate[pair]", "meshes.translate[1]"]
    waiting = sought(jaxrt.build(SCENE), names).turns_of_placed
    np.testing.assert_array_equal(waiting, [True] * 3 + [False] * 9)
    assert [stage.turning for stage in STAGES] == [False, True, True]


def test_what_waits_is_held(quick_compilation):
    """Its derivatives are 0, the others and the picture what they are."""
    scene, target = jaxrt.with_parameters(jaxrt.build(SCENE), {"meshes.rotate[flat]": [0, 20, 0]}), jnp.ones((4, 4, 3))
    unknowns = sought(scene, ["meshes.rotate[flat]", "meshes.translate[flat]"])
    machine = Machine(Problem(scene, unknowns, target, jnp.ones_like(target), 1, boundary_samples=0))
    (picture, free), (same, held) = (machine.evaluate(machine.start, 0, Drawing(4, turning=on)) for on in (True, False))
    np.testing.assert_array_equal(picture, same)
    np.testing.assert_array_equal(held[..., 3:], free[..., 3:])
    assert not held[..., :3].any() and free[..., :3].any(axis=(0, 1, 2)).all()
