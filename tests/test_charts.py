"""The charts' arithmetic, their closed forms, and that the page in docs is what its numbers say."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from rich.progress import Progress

import jaxrt
from benchmarks.alternatives.chance import draw_sum_by_chance
from benchmarks.chart import closed, edges
from benchmarks.chart.curves import Point, by_scene, crossing, envelope, pareto_front, read_csv, write_csv
from benchmarks.chart.measure import WARM_UP, Metric, Sweep, measure
from benchmarks.chart.page import CHARTS, page_of
from benchmarks.chart.references import cached, content_key, mean_image
from benchmarks.chart.store import load
from benchmarks.chart.subjects import Drawn, picture_method, prefix_method
from benchmarks.edge_peer import text_of
from benchmarks.edge_tables import bumps
from benchmarks.samplers import Reference
from jaxrt.render import draw_sum

ROOT = Path(__file__).parent.parent
BALL = "scenes/ball_on_floor.toml"


def curve(*pairs: tuple[float, float]) -> list[Point]:
    return [Point(4**i, 16, t, e, e, e) for i, (t, e) in enumerate(pairs)]


# Curves


def test_front_is_what_no_line_passes_below() -> None:
    fast = curve((1, 1), (4, 0.25), (16, 0.0625))
    slow = curve((2, 0.45), (8, 0.25), (32, 0.01))
    # fast's line is at 0.5 after 2 s and below 0.25 after 8 s; slow's at 0.05 after 16 s
    assert pareto_front({"slow": slow, "fast": fast}) == [fast[0], slow[0], fast[1], slow[2]]


def test_envelope_never_rises_and_touches_the_front() -> None:
    curves = {"a": curve((1, 1), (4, 0.5), (16, 0.6)), "b": curve((3, 0.4), (20, 0.3))}
    times, best = envelope(curves)
    assert np.all(np.diff(best) <= 0) and best[0] == pytest.approx(1) and best[-1] == pytest.approx(0.3)
    # Between b's points along its line, though a rises again
    assert best[np.searchsorted(times, 16)] == pytest.approx(
        0.4 * (16 / 3) ** (np.log(0.75) / np.log(20 / 3)), rel=0.01
    )


@pytest.mark.parametrize(("target", "measured"), [(0.02, True), (0.003, False), (0.7, False)])
def test_crossing_of_a_power_law(target: float, measured: bool) -> None:
    """Of e = 0.3 t^−½, 0.1 s a sample: t = (0.3/e)², between the points and beyond them."""
    found = crossing([Point(n, 4, 0.1 * n, 0.3 * (0.1 * n) ** -0.5, 0, 0) for n in (4, 16, 64, 4096)], target)
    assert found is not None and found.measured is measured
    assert found.seconds == pytest.approx((0.3 / target) ** 2) and found.spp == pytest.approx(10 * found.seconds)


def test_a_floor_has_no_crossing_below() -> None:
    assert crossing(curve((1, 0.5), (4, 0.1), (16, 0.1)), 0.01) is None
    assert crossing(curve((1, 0.5)), 0.5) is None


def test_csv_keeps_what_it_is_given(tmp_path: Path) -> None:
    curves = {"a, with 4,096": curve((0.012345, 0.5), (4, 0.25)), "b": curve((1, 0.1))}
    write_csv(tmp_path / "c.csv", curves)
    assert read_csv(tmp_path / "c.csv") == curves
    assert [line[-1] for line in (tmp_path / "c.csv").read_text().splitlines()[1:]] == ["1", "0", "1"]


def test_scenes_of_a_chart_have_fronts_of_their_own(tmp_path: Path) -> None:
    curves = {"near: a": curve((1, 0.1), (4, 0.05)), "far: a": curve((2, 0.9), (8, 0.4)), "far: b": curve((3, 0.95))}
    assert by_scene(curves)["far"] == {"a": curves["far: a"], "b": curves["far: b"]}
    write_csv(tmp_path / "c.csv", curves)
    assert [line[-1] for line in (tmp_path / "c.csv").read_text().splitlines()[1:]] == ["1", "1", "1", "1", "0"]


# Measurement


def test_errors_are_free_of_the_reference_s_own() -> None:
    """Normal pictures of deviation 1/√spp, a reference of deviation 0.05: with 16 × 30,000 numbers the error's relative
    deviation is √(1/960,000) from the pictures, and from the reference 2·0.05·√spp/√30,000 at most; 5 of them, a false
    alarm in 2 million."""
    rng = np.random.default_rng(1)
    truth = 2 + rng.random((100, 100, 3))

    def draw(seed: int, lengths: Sequence[int]) -> Drawn:
        noise = np.random.default_rng(seed)
        return {n: (truth + noise.normal(0, n**-0.5, truth.shape), 0.01 * n) for n in lengths}

    reference = mean_image(lambda seed: draw(seed, [100])[100][0], 4)
    assert reference.variance == pytest.approx(0.0025, rel=5 * np.sqrt(2 / 90_000))
    metric = Metric(reference, 2.0)
    with Progress(disable=True) as progress:
        ((points,),) = (c.values() for c in measure({"m": draw}, Sweep((1, 16), (64,), 16, 4), [metric], progress))
    assert [(p.spp, p.images, p.seconds) for p in points] == [(1, 16, 0.01), (16, 16, 0.16), (64, 4, 0.64)]
    for p in points:
        limit = 5 * np.hypot(np.sqrt(1 / (2 * p.images * 30_000)), 0.1 * np.sqrt(p.spp / 30_000 / p.images))
        assert p.error == pytest.approx(p.spp**-0.5 / 2, rel=limit), p
        assert p.low <= p.error <= p.high


def test_references_are_made_once(tmp_path: Path) -> None:
    made = []

    def make() -> Reference:
        made.append(1)
        return Reference(np.arange(12.0).reshape(2, 2, 3), 0.25)

    scene = tmp_path / "scene.toml"
    for text, spp in (("a", 1), ("a", 1), ("b", 1), ("b", 2), ("b", 2)):
        scene.write_text(text)
        found = cached(tmp_path / "cache", content_key([scene], {"spp": spp}), make)
        np.testing.assert_array_equal(found.image, np.arange(12.0).reshape(2, 2, 3))
        assert found.variance == 0.25
    assert len(made) == len(list((tmp_path / "cache").iterdir())) == 3


def test_calls_are_meant_as_they_come() -> None:
    """Each with a seed of its own, also of other lengths; the picture is its seed."""
    drawn: list[int] = []

    def program(seed: Any, spp: Any) -> np.ndarray:
        assert spp == 16
        drawn.append(int(seed))
        return np.full((2, 2, 3), float(seed))

    draw = edges._calls(program, 16)
    one, more = draw(WARM_UP, [1]), draw(WARM_UP, [2, 4])
    assert list(one) == [16] and list(more) == [32, 64]
    assert len(set(drawn)) == 5
    for spp, seeds in ((16, drawn[:1]), (32, drawn[1:3]), (64, drawn[1:])):
        np.testing.assert_allclose((one | more)[spp][0], np.mean(seeds))
    assert 0 < more[32][1] < more[64][1]


@pytest.mark.parametrize("panel", edges.PANELS, ids=lambda panel: panel.title)
def test_mitsuba_reads_and_moves_what_jaxrt_does(panel: edges.Panel, tmp_path: Path) -> None:
    row = panel.of
    description = edges._described(row)
    (tmp_path / "scene.toml").write_text(text_of(edges._tables(description)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        read, built = jaxrt.load_scene(tmp_path / "scene.toml"), jaxrt.build(description)
    assert jax.tree.structure(read) == jax.tree.structure(built)
    for a, b in zip(jax.tree.leaves(read), jax.tree.leaves(built), strict=True):
        np.testing.assert_array_equal(a, b)
    kind, number = panel.moved.split("_")
    name = description[{"sphere": "spheres", "mesh": "meshes"}[kind]][int(number)]["name"]
    assert row.parameter in (f"spheres.center[{name}]", f"meshes.vertices[{name}]") and row.motion == "x"


@pytest.fixture(scope="module")
def floor() -> jaxrt.Scene:
    return jaxrt.build(closed.FLOOR)


def test_prefixes_are_the_pictures_that_render_draws(floor: jaxrt.Scene) -> None:
    """With one program: sums of parts differ by rounding."""
    options: dict[str, Any] = {"max_depth": 1, "devices": jax.devices()[:1]}
    program: Any = draw_sum
    whole = picture_method(floor, **options)(3, [16, 64])
    programs = program._cache_size()
    parts = prefix_method(floor, **options)(3, [16, 64])
    assert program._cache_size() == programs
    for spp in (16, 64):
        np.testing.assert_allclose(parts[spp][0], whole[spp][0], rtol=1e-6)
    assert 0 < parts[16][1] < parts[64][1]


# Closed forms


def test_floor_picture(floor: jaxrt.Scene) -> None:
    """Sobol' noise at 64 samples is 5e-4 of the mean (measured), and 1e-5 of the whole picture's mean."""
    image = picture_method(floor, max_depth=1, devices=jax.devices()[:1])(0, [64])[64][0]
    reference = closed.floor_picture().image
    error = (image - reference) / reference.mean()
    assert np.sqrt((error**2).mean()) < 1e-3
    assert abs(error.mean()) < 5e-5


def test_light_found_by_chance_is_the_same_light(floor: jaxrt.Scene) -> None:
    """The share p of paths that find the light gives the mean a relative deviation below √(1/(n p)); p is the picture
    times d², at least 0.01: 5 deviations of n = 2²² paths, a false alarm in 2 million."""
    draw = prefix_method(floor, draw_sum_by_chance, sampler="independent", max_depth=1, devices=jax.devices()[:1])
    image, reference = draw(0, [1024])[1024][0], closed.floor_picture().image
    assert image.mean() == pytest.approx(reference.mean(), rel=5 * np.sqrt(1 / (1024 * 4096 * 0.01)))
    # Pixel by pixel it is noisy
    assert np.sqrt(((image - reference) ** 2).mean()) > 0.05 * reference.mean()


@pytest.mark.parametrize("axis", [0, 2])
def test_derivative_of_the_ball_s_picture(axis: int) -> None:
    """Of 16 smooth functionals, against central differences of the quadrature: its jitter of edges, 16 points a pixel,
    leaves 2e-3 (measured), while the shading alone is off by 5e-2 and more."""
    ball, h = closed.ball_of(BALL, 64), 0.2
    moved = [ball._replace(light=ball.light + s * h * np.eye(3)[axis]) for s in (1, -1)]
    above, below = (bumps(closed.shading(b, axis, 16)[0]) for b in moved)
    expected = (above - below) / (2 * h)
    inside = closed.shading(ball, axis, 16)[1]
    scale = np.linalg.norm(expected)
    assert np.linalg.norm(bumps(inside) - expected) > 0.04 * scale
    assert np.linalg.norm(bumps(inside + closed.moving_shadow(ball, axis, 1 << 16)) - expected) < 5e-3 * scale


# The page


def test_page_is_what_the_numbers_say() -> None:
    found = load(ROOT / "docs/charts")
    assert list(found) == list(CHARTS)
    page = (ROOT / "docs/charts.md").read_text(encoding="utf-8")
    assert page == page_of(found), "docs/charts.md is stale: run python -m benchmarks.chart --draw"
    for name in CHARTS:
        assert f"(charts/{name}.png)" in page
        assert all((ROOT / f"docs/charts/{name}.{kind}").stat().st_size > 1000 for kind in ("png", "svg"))
    assert "{" not in page
    assert all(run["settings"] == "full" for _, run in found.values())
    # What it says of derivatives rests on a reference that edge samples come as near to as its own error
    derivatives = found["derivatives-picture"][0]
    assert derivatives.curves["with 65,536 edge samples"][-1].error < 2 * derivatives.band < 0.01


def test_page_leaves_out_what_was_not_measured() -> None:
    found = load(ROOT / "docs/charts")
    page = page_of({"depth": found["depth"]})
    assert "## Depth" in page and "## Light sampling" not in page and "## What to choose" not in page
