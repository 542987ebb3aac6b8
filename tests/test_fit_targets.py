"""Fits of outputs: what is given by name, each in its own units."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.fit import FitError, Machine, Problem, sought
from jaxrt.fit.lacks import missing_terms
from jaxrt.fit.solve import Drawing
from jaxrt.fit.targets import joined, parted, scale_of, targets_of
from jaxrt.gradcheck.coverage import CROSSING
from jaxrt.views import asked_for

SCENE = {
    "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "width": 12, "height": 12},
    "materials": {"red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]}},
    "spheres": [
        {"name": "ball", "center": [0.1, 0, 0], "radius": 0.8, "material": "red"},
        {"center": [0, 0, -1002], "radius": 1000, "material": "red"},
    ],
    "lights": [{"position": [1, 1, 3], "intensity": 30}],
}


@pytest.fixture(scope="module")
def scene() -> jaxrt.Scene:
    return jaxrt.build(SCENE)


def test_outputs_are_one_picture_and_are_parted_again(scene: jaxrt.Scene) -> None:
    rng = np.random.default_rng(0)
    target = {"depth": rng.uniform(size=(4, 5)), "normal": rng.normal(size=(4, 5, 3)), "mask[ball]": np.ones((4, 5))}
    weight = {"depth": rng.uniform(size=(4, 5)) > 0.5}
    found = targets_of(scene, [target], [weight])
    assert found.by_name and found.pictures[0].shape == (4, 5, 5)
    for name, part in parted(np.asarray(found.pictures[0]), found.outputs).items():
        np.testing.assert_allclose(part, target[name] * weight.get(name, 1), rtol=1e-6)


def test_outputs_count_alike_in_their_own_units_and_by_their_weights(scene: jaxrt.Scene) -> None:
    """Ten times the unit of one changes nothing, nor does how far all is; twice its weight counts it four times."""
    rng, outputs = np.random.default_rng(0), asked_for(scene, ["depth", "radiance"])
    depth, light = rng.uniform(size=(4, 5)), rng.uniform(size=(4, 5, 3))

    def shares(depth: Any, weight: float) -> list[float]:
        target = joined({"depth": depth, "radiance": light})
        weights = np.ones((4, 5, 4)) * [[[weight, 1, 1, 1]]]
        away = parted(np.asarray(target - target.mean((0, 1), keepdims=True)), outputs)["depth"]
        units = parted(scale_of(target, weights, outputs), outputs)
        return [float(np.sum((x / units[n]) ** 2)) for n, x in (("depth", weight * away), ("radiance", light))]

    assert shares(depth, 1) == pytest.approx([0.5, 0.5], rel=1e-5)
    assert shares(10 * depth, 1) == pytest.approx([0.5, 0.5], rel=1e-5)
    assert shares(depth + 2, 1) == pytest.approx([0.5, 0.5], rel=1e-5)
    assert shares(depth, 2) == pytest.approx([0.8, 0.2], rel=1e-5)
    flat = parted(
        scale_of(joined({"depth": np.ones((4, 5))}), np.ones((4, 5, 1)), asked_for(scene, ["depth"])), outputs
    )
    assert flat["depth"].item() == pytest.approx(0.1 * 20**0.5)


def test_an_output_that_is_0_everywhere_has_no_size(scene: jaxrt.Scene) -> None:
    target = jnp.stack([jnp.ones((4, 5)), jnp.zeros((4, 5))], -1)
    with pytest.raises(FitError, match=r"target: mask\[ball\]: black, or masked everywhere: choose another picture"):
        scale_of(target, jnp.ones_like(target), asked_for(scene, ["depth", "mask[ball]"]))


ONES = np.ones((12, 12))
WRONG = [
    ({}, None, "target: outputs is empty"),
    ({"dept": ONES}, None, r'target: unknown output "dept" \(did you mean "depth"\?\)'),
    ({"mask[bal]": ONES}, None, r'^mask\[bal\]: nothing .* \(did you mean "ball"\?\)'),
    ({"shape": ONES}, None, 'target: "shape" has no derivative'),
    ({"depth": np.ones((12, 12, 3))}, None, r"target: depth: shape \(12, 12, 3\), want \(height, width\)"),
    ({"depth": "far"}, None, r'target: depth: "far", want \(height, width\)'),
    ({"depth": ONES, "normal": np.ones((6, 6, 3))}, None, "outputs of one view differ in size"),
    ({"depth": ONES}, ONES, "weight: want a dict"),
    ({"depth": ONES}, {"alpha": ONES}, "weight: want a dict, as the target is, of depth"),
    ({"depth": ONES}, {"depth": -ONES}, "weight: depth: has numbers that are negative"),
    ([ONES], None, r"target: shape \(1, 12, 12\)"),
    ([{"depth": ONES}], None, "target: .* want .height, width, 3."),
]


@pytest.mark.parametrize(("target", "weight", "message"), WRONG, ids=[m[:30] for *_, m in WRONG])
def test_what_cannot_be_matched_is_refused_in_one_line(scene: jaxrt.Scene, target, weight, message: str) -> None:
    with pytest.raises(FitError, match=message) as refusal:
        jaxrt.fit(scene, target, ["spheres.center[ball]"], weight=weight, max_depth=1)
    assert "\n" not in str(refusal.value)


def test_views_show_the_same_outputs(scene: jaxrt.Scene) -> None:
    with pytest.raises(FitError, match="views show different things: give each a dict of depth"):
        jaxrt.fit([scene, scene], [{"depth": ONES}, {"alpha": ONES}], ["spheres.center[ball]"], max_depth=1)


def test_what_light_alone_lacks_is_not_told_of_what_is_met_first(scene: jaxrt.Scene) -> None:
    crossed = jaxrt.with_parameters(scene, {"spheres.center[ball]": [0, 0, -1.9]})
    unknowns = sought(crossed, ["spheres.center[ball]"])
    assert missing_terms(crossed, unknowns, 2) == {"spheres.center[ball]": (CROSSING,)}
    assert missing_terms(crossed, unknowns, 2, light=False) == {}


def test_what_is_compared_is_what_render_returns(scene: jaxrt.Scene, quick_compilation) -> None:
    """Light and what is met first, each drawn as `render` draws it; the rest is as for pictures."""
    outputs = asked_for(scene, ("depth", "radiance"))
    target = joined(jaxrt.render(scene, 3, spp=4, max_depth=1, outputs=outputs.names))
    weight = jnp.ones_like(target)
    problem = Problem(scene, sought(scene, ["spheres.center[ball]"]), target, weight, 1, boundary_samples=0)
    machine = Machine(replace(problem, outputs=outputs))
    residual, jacobian = machine.evaluate(machine.start, 3, Drawing(4))
    np.testing.assert_allclose(residual, 0, atol=1e-6)
    assert (np.abs(jacobian[..., 0, :]).max(axis=(0, 1)) > 0).all() and jacobian.shape == (*target.shape, 3)
