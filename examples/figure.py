"""What the examples share: their arguments, a recorder of losses, a clock, and the figure that each one leaves."""

import argparse
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from jaxrt.io.color import gamma_encode

BEGIN = time.perf_counter()


def arguments(description: str | None) -> argparse.Namespace:
    """Return --quick, a small run for tests, and --output, the folder of the figure."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--quick", action="store_true", help="a small, rough run")
    parser.add_argument("--output", type=Path, default=Path("."), help="folder of the figure")
    return parser.parse_args()


def recorder(losses: list[float]) -> Callable[..., None]:
    """Return what an optimistix solver takes as `verbose`: it appends the loss of each step to `losses`."""

    def verbose(**told: tuple[str, Any]) -> None:
        loss = next(value for name, (_, value) in told.items() if name in ("loss_this_step", "loss"))
        jax.debug.callback(lambda loss: losses.append(float(loss)), loss)

    return verbose


def solved(name: str, solve: Callable[..., tuple[Any, Any]], picture: Callable[[Any], Any], *arguments: Any) -> Any:
    """Return the answer of solve(start, ...) -> (answer, steps); print what it took.

    That is its steps, its seconds and how many pictures could be drawn in them, those of compiling, and all since the
    example began.
    """
    begin = time.perf_counter()
    program = jax.jit(solve).lower(*arguments).compile()
    compiled = time.perf_counter()
    answer, steps = jax.block_until_ready(program(*arguments))
    done = time.perf_counter()
    jax.effects_barrier()
    jax.block_until_ready(picture(arguments[0]))
    drawing = time.perf_counter()
    jax.block_until_ready(picture(arguments[0]))
    renders = (done - compiled) / (time.perf_counter() - drawing)
    print(
        f"{name}: {int(steps)} steps, {done - compiled:.2f} s, as long as {renders:.0f} renders; "
        f"compiled in {compiled - begin:.1f} s; {done - BEGIN:.1f} s from the start"
    )
    return answer


def save_figure(
    path: Path, target: ArrayLike, pictures: Mapping[str, ArrayLike], losses: Mapping[str, list[float]]
) -> None:
    """Write target | pictures (the first is the start) | error of the last ones | loss curves as a PNG."""
    target = np.asarray(target)
    bright = float(np.quantile(target.max(axis=-1), 0.99))
    errors = {f"{name} - target": np.mean(np.asarray(p) - target, axis=-1) for name, p in list(pictures.items())[1:]}
    shown = {"target": target, **pictures}
    figure = Figure(figsize=(2.6 * (len(shown) + len(errors) + 1.3), 2.7), layout="constrained")
    axes = figure.subplots(1, len(shown) + len(errors) + 1, width_ratios=[1] * (len(shown) + len(errors)) + [1.3])
    for place, (title, picture) in zip(axes, shown.items(), strict=False):
        place.imshow(np.clip(gamma_encode(np.asarray(picture) / bright), 0, 1))
        place.set_title(title, fontsize=9)
    widest = max(float(np.quantile(np.abs(error), 0.995)) for error in errors.values()) or 1.0
    for place, (title, error) in zip(axes[len(shown) :], errors.items(), strict=False):
        image = place.imshow(error, cmap="RdBu_r", vmin=-widest, vmax=widest)
        place.set_title(title, fontsize=9)
    figure.colorbar(image, ax=axes[-2], shrink=0.7)
    for place in axes[:-1]:
        place.set_axis_off()
    for name, curve in losses.items():
        axes[-1].semilogy(np.minimum.accumulate(curve), ".-", label=name)
    axes[-1].set_title("loss", fontsize=9)
    axes[-1].set_xlabel("step")
    axes[-1].grid(alpha=0.3)
    axes[-1].legend(fontsize=7)
    figure.savefig(path, dpi=75)
    print(f"figure: {path}")
