"""`jaxrt render`."""

import argparse
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxrt.chunks import accumulate
from jaxrt.cli import start, together
from jaxrt.cli.commands.layers import draw_layers, layers_asked
from jaxrt.cli.errors import UsageError
from jaxrt.cli.job import begin, facts_of, samples_of, sums_beside
from jaxrt.cli.places import check_file
from jaxrt.cli.progress import compiling, progress
from jaxrt.cli.saving import ELSEWHERE, Picture, save, save_picture
from jaxrt.cli.signals import Interrupted, noted, status_of
from jaxrt.cli.start import built, check_output, described, warn
from jaxrt.core.samplers import SAMPLERS
from jaxrt.description import nearest, show
from jaxrt.hands import painter
from jaxrt.hosts.team import Team
from jaxrt.io.partial import SUFFIX, Partial
from jaxrt.render import prepare
from jaxrt.scene import Scene
from jaxrt.transport.film import Plan, Run

CHECKPOINT_SECONDS = 120.0  # what KILL or a power cut may cost; the environment may say otherwise


@dataclass
class Work:
    """A render under way: `sums` is whole at every moment, and all that is to be saved."""

    args: argparse.Namespace
    output: Path
    cores: int
    end: int
    sums: Partial
    team: Team | None
    layers: Callable[[NDArray[np.float32]], Picture]  # what is to be saved, of a picture
    compile_seconds: float = 0.0
    render_seconds: float = 0.0

    @property
    def drawn(self) -> int:
        """Samples drawn so far."""
        return self.sums.end - self.sums.first

    @property
    def done(self) -> bool:
        return self.sums.end == self.end


def run(args: argparse.Namespace) -> int:
    """Draw, write the picture or sums, and return the exit status."""
    if isinstance(args.hosts, list):
        return together.start(args.hosts, args.words)
    output = _output(args)
    description = described(args)
    began = time.perf_counter()
    cores = start.present(args.cores)
    folder = start.start_jax(1)
    spp = description.render.spp
    first, end = samples_of(args.samples, spp)
    team = together.joined(args.hosts) if args.hosts else None
    leads = team is None or team.rank == 0
    _check_sampler(args.sampler, spp, leads)
    # No sample, which compiles all the same
    scene, own = built(description, warn if leads else lambda message: None), jax.local_devices() if team else None
    asked = layers_asked(scene, args.outputs, output.suffix == SUFFIX)
    nothing = prepare(scene, args.seed, 0, 0, spp, sampler=args.sampler, devices=own)
    facts = facts_of(nothing[0], nothing[2], args.seed, spp)
    if team:
        together.check_alike(team, facts)
        if team.rank:
            return together.follow(team, painter(folder, *nothing, cores, team), nothing[1])

    def with_layers(picture: NDArray[np.float32]) -> Picture:
        if asked is None:
            return picture
        return draw_layers(asked, scene, picture, nothing[1]._replace(end=jnp.int32(spp)), nothing[2], folder, cores)

    work = Work(args, output, cores, end, begin(output, args.resume, facts, first, end), team, with_layers)
    before = work.drawn
    if team:
        team.lost = partial(_keep_from_loss, work, before)
    with ExitStack() as signals:
        try:
            _draw(work, *nothing, folder, signals)
            status = _finish(work)
        except KeyboardInterrupt as interrupt:
            if work.drawn == 0:
                raise
            _keep_all(work)
            return status_of(interrupt)
        except Exception:
            if work.drawn > before:
                with suppress(UsageError):
                    _keep_sums(work)
            raise
    _tell(work, work.drawn - before, time.perf_counter() - began)
    return status


def _output(args: argparse.Namespace) -> Path:
    """Return where the result goes, having made sure that it can."""
    name = f"{args.scene.stem or 'scene'}.png"
    output: Path = args.output or Path(name)
    if args.samples is None:
        check_output(output, name)
    elif args.output is None or output.suffix != SUFFIX:
        raise UsageError(f"argument --samples: writes sums, not a picture: name them with -o, such as -o a{SUFFIX}")
    else:
        check_file(output)
    return output


def _check_sampler(name: str, spp: int, leads: bool) -> None:
    if name not in SAMPLERS:
        raise UsageError(f"argument --sampler: unknown sampler {show(name)}{nearest(name, SAMPLERS)}")
    if name == "sobol" and spp & (spp - 1) and leads:
        below = 1 << (spp.bit_length() - 1)
        warn(f"spp {spp} is not a power of two: sobol is at its best with {below} or {2 * below}")


def _draw(work: Work, scene: Scene, run: Run, plan: Plan, folder: Path | None, signals: ExitStack) -> None:
    """Draw the samples that are missing; keep the sums now and then.

    From the first sample on to the end of `signals`, a signal ends the drawing alone. Raises Interrupted then.
    """
    interval = float(os.environ.get("JAXRT_CHECKPOINT_SECONDS", CHECKPOINT_SECONDS))
    with progress(work.end - work.sums.first) as report:
        began = time.perf_counter()
        with compiling():
            if work.team is None:
                draw_run = painter(folder, scene, run, plan, work.cores)
            else:
                draw_run = together.leading(work.team, painter(folder, scene, run, plan, work.cores, work.team))
        compiled = kept = time.perf_counter()
        work.compile_seconds = compiled - began
        report(work.drawn)
        stop = signals.enter_context(noted())

        def draw(first: int, count: int) -> NDArray[np.float32]:
            return draw_run(run._replace(first=jnp.int32(first), end=jnp.int32(first + count)))

        def keep(sums: Partial) -> bool:
            nonlocal kept
            work.sums = sums
            report(work.drawn)
            if time.perf_counter() - kept >= interval and not work.done:
                _checkpoint(work)
                kept = time.perf_counter()
            return not stop.number

        accumulate(draw, work.sums, work.end, keep)
        if work.team:
            work.team.leave(0, 0)
        work.render_seconds = time.perf_counter() - compiled
    if not work.done:
        raise Interrupted(stop.number)


def _finish(work: Work) -> int:
    """Write what was asked for and return the exit status."""
    if work.output.suffix == SUFFIX:
        return 0 if _keep_sums(work) else ELSEWHERE
    picture = work.layers(work.sums.picture())
    status = save_picture(work.output, picture, work.args.exposure, work.args.srgb)
    with suppress(OSError):
        sums_beside(work.output).unlink(missing_ok=True)
    return status


def _keep_from_loss(work: Work, before: int, ranks: list[int]) -> None:
    """Write what there is when hosts are lost. The thread that draws is not asked: it may wait for them for ever."""
    assert work.team is not None
    if work.drawn > before:
        _keep_all(work, together.loss(work.team, ranks))
    else:
        together.tell_loss(work.team, ranks)


def _keep_all(work: Work, why: str = "interrupted") -> None:
    """Write the sums and the picture so far, and say how to go on."""
    try:
        placed = _keep_sums(work)
    finally:
        if work.output.suffix != SUFFIX:
            save_picture(work.output, work.sums.picture(), work.args.exposure, work.args.srgb)
    what = f"{work.drawn} of {work.end - work.sums.first} samples a pixel are in {work.output}"
    remedy = "go on with --resume" if placed else "move the sums beside it, then go on with --resume"
    print(f"jaxrt: {why}: {what}: {remedy}", file=sys.stderr)


def _keep_sums(work: Work) -> bool:
    return save(sums_beside(work.output), work.sums.write, "sums")


def _checkpoint(work: Work) -> None:
    try:
        work.sums.write(sums_beside(work.output))
    except OSError as error:
        warn(f"{sums_beside(work.output)}: {error.strerror or error}: drawing on, make room")


def _tell(work: Work, drawn: int, seconds: float) -> None:
    facts = work.sums.facts
    width, height, sampler = int(facts["width"]), int(facts["height"]), facts["sampler"]
    rate = width * height * drawn / max(work.render_seconds, 1e-9) / 1e6
    asked = f" of {facts['spp']} (samples {work.sums.first}:{work.end})" if work.args.samples else ""
    print(
        f"{work.output}: {width}x{height}, {work.drawn} spp{asked}, max_depth {facts['max_depth']}, {sampler}: "
        f"compile {work.compile_seconds:.2f} s, render {work.render_seconds:.2f} s, {rate:.2f} Mpaths/s, "
        f"all {seconds:.2f} s"
    )
