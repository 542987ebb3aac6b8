"""Configurations of Mitsuba's own tests: scenes that can be read, motions of what is in them, its measure."""

import warnings

import numpy as np
import pytest

import jaxrt
from benchmarks.edge_peer import CONFIGURATIONS, SIZE, Configuration, Ours, errors, noises, write


@pytest.mark.parametrize("configuration", CONFIGURATIONS, ids=lambda configuration: configuration.name)
def test_motion_is_of_what_mitsuba_moves(configuration: Configuration, tmp_path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        ours = Ours(configuration, write(configuration, tmp_path))
    assert ours.scene.camera.width == SIZE
    for name, value in ours.start.items():
        assert np.abs(ours.along[name]).max(initial=0) > 0, name
        if configuration.motion == "scale" and name == "lights.intensity":
            # d(π r² radiance)/dr at r = 1
            np.testing.assert_allclose(ours.along[name], 2 * value, rtol=1e-6)


def test_errors_are_relative_to_the_larger_of_slope_and_a_fifth() -> None:
    truth = np.full((3, 3, 3), 2.0)
    truth[0] = 0.1
    pixel, bump = errors(np.stack([truth + 0.1, truth + 0.3]), truth)
    assert pixel == pytest.approx((0.2 / 0.2 + 2 * 0.2 / 2) / 3)
    assert 0.1 < bump < 0.2
    pixel, bump = noises(np.stack([truth, truth]), truth)
    assert pixel == bump == 0
