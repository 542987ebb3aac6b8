"""Derivatives of edges that move, and what they are checked against: cases A2, A9 and A11.

`gradcheck` compares with finite differences of pictures with the same random numbers.
"""

from functools import cache

import numpy as np
import pytest

import jaxrt

# A2: moving shadows


@cache
def shadow_report():
    """Return the check of d/d(light x) for a ball over a floor."""
    scene = jaxrt.build(
        {
            "camera": {"position": [0, -5, 4], "target": [0, 0, 0.2], "up": [0, 0, 1], "width": 48, "height": 36}
            | {"fov": 45},
            "materials": {"grey": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
            "spheres": [
                {"center": [0, 0, 1], "radius": 0.4, "material": "grey"},
                {"center": [0, 0, -100], "radius": 100, "material": "grey"},
            ],
            "lights": [{"position": [0.5, 0, 3], "intensity": 10}],
        }
    )
    options = {"component": 0, "spp": 128, "max_depth": 1, "step": 0.05, "seeds": 4, "boundary_samples": 8192}
    return jaxrt.gradcheck(scene, "lights.position", 0, **options, tolerance=0.05)


def moment(picture):
    """Return Σ x p, x from −1 to 1 across the picture."""
    x = (2 * np.arange(picture.shape[1]) + 1) / picture.shape[1] - 1
    return float(np.sum(picture[..., 0].astype(float) @ x))


def test_a2_with_edges_the_derivative_is_right(figures):
    """To 5 % or 4σ of finite differences in moments, Gaussian bumps and an L2 loss; two steps agree."""
    report = shadow_report()
    assert report.verdict == "agrees", str(report)
    (found,) = report.components
    error, bad = (abs(moment(x) / moment(found.finite) - 1) for x in (found.total, found.interior))
    what = "error of a moving shadow's derivative, first moment; naive: plain differentiation"
    figures("A2", what, naive=bad, ours=error, at_most=0.03)
    error, bad = (found.groups[-1].total.share, found.groups[-1].interior.share)
    figures(
        "A2",
        "error of a moving shadow's derivative, slope of an L2 loss; naive: plain differentiation",
        naive=bad,
        ours=error,
        at_most=0.05,
    )
    assert report.coverage.included == ("interior", "shadow edges")


def test_a2_the_mean_does_not_see_it():
    """What one side of a shadow gains the other loses."""
    (found,) = shadow_report().components
    assert np.sum(found.interior) == pytest.approx(np.sum(found.finite), rel=0.2)


@pytest.mark.xfail(reason="plain automatic differentiation misses moving shadows: the L2 loss's slope is 53 % off")
def test_a2_interior_only(figures):
    (found,) = shadow_report().components
    shares = [group.interior.share for group in found.groups]
    figures(
        "A2",
        "error of a moving shadow's derivative with boundary_samples = 0, interior only",
        ours=shares,
        at_most=0.05,
    )


def test_a2_how_wrong_plain_ad_is():
    """As measured: 11 % of all first moments, 28 % in Gaussian bumps, 53 % of the slope of an L2 loss."""
    (found,) = shadow_report().components
    errors = [group.interior.share for group in found.groups]
    np.testing.assert_allclose(errors, [0.108, 0.283, 0.532], atol=0.02)


def test_a9_finite_differences_of_two_steps(figures):
    """What derivatives are checked against; naive: a step near the spacing of numbers, of a smooth function."""
    (found,) = shadow_report().components
    apart = [group.steps.share for group in found.groups]
    figures("A9", "difference of finite differences of two steps", ours=apart, at_most=0.05)
    x = np.linspace(0, 1, 1000, dtype=np.float32)
    naive, error = (
        np.abs((np.sin(x + h) - np.sin(x - h)) / (2 * h) - np.cos(x)).max() for h in np.float32([1e-6, 3e-3])
    )
    figures(
        "A9",
        "error of central differences of sin in float32, step 3e-3; naive: 1e-6",
        naive=naive,
        ours=error,
        at_most=1e-3,
    )


# A11: lights in mirrors


@cache
def mirror_report():
    """Return the check of d/d(light x) where the camera sees the light in a mirror."""
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 40, "width": 24, "height": 16},
            "materials": {"mirror": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]}},
            "triangles": [{"vertices": [[-9, -9, 0], [9, -9, 0], [0, 18, 0]], "material": "mirror"}],
            "lights": [{"position": [0.2, 0.1, 5], "intensity": 3, "radius": 0.5}],
        }
    )
    options = {"component": 0, "spp": 512, "max_depth": 1, "step": 0.1, "seeds": 4, "boundary_samples": 1024}
    return jaxrt.gradcheck(scene, "lights.position", 0, **options)


@pytest.mark.usefixtures("quick_compilation")
def test_a11_a_light_that_moves_in_a_mirror(figures):
    (found,) = mirror_report().components
    what = "error of the derivative of a light that moves in a mirror; naive: plain differentiation"
    naive, share = found.groups[0].interior.share, found.groups[0].total.share
    figures("A11", what, naive=naive, ours=share, at_most=0.05)


@pytest.mark.usefixtures("quick_compilation")
def test_a11_gradcheck_says_so():
    found = mirror_report().coverage
    assert "edges seen in mirrors and through glass" in found.included and not found.missing
