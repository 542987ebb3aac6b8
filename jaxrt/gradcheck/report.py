"""What a check of derivatives found, and the verdict."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jaxrt.gradcheck.coverage import Coverage
from jaxrt.gradcheck.functionals import Numbers

SIGMAS = 4.0  # a difference counts from here on: one of 16 000 normal numbers exceeds it
NOTHING = 1e-5  # a share that is rounding, however many standard errors it may be
HIDES = 2.0  # noise hides what it exceeds so many times over

Verdict = Literal["agrees", "differs", "inconclusive"]
Image = NDArray[np.float32]


@dataclass(frozen=True)
class Difference:
    """How far two derivatives are apart, as a share of the finite difference."""

    share: float
    noise: float  # standard error of `share`

    @property
    def sigmas(self) -> float:
        """Standard errors in the difference."""
        return self.share / self.noise if self.noise > 0 else (np.inf if self.share > 0 else 0.0)

    def exceeds(self, tolerance: float) -> bool:
        """Return whether it is larger than the tolerance, and no accident."""
        return self.share > tolerance and self.sigmas > SIGMAS

    def __str__(self) -> str:
        if self.share < NOTHING:
            return percent(self.share)
        sigmas = f"{self.sigmas:.1f}" if self.sigmas < 10 else f"{min(self.sigmas, 999):.0f}"
        return f"{percent(self.share)} ({sigmas} sigma)"


def percent(share: float) -> str:
    """Return a share in per cent, of two digits, and no more decimals than mean something."""
    if share < NOTHING:
        return f"below {100 * NOTHING:g} %" if share > 0 else "0 %"
    return f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"


@dataclass(frozen=True)
class Group:
    """One group of functionals, compared as vectors in the Euclidean norm."""

    name: str
    size: float  # of the finite difference
    noise: float  # its standard error, in the same unit
    steps: Difference  # between finite differences of two steps
    interior: Difference  # of automatic differentiation without edges from the finite difference
    total: Difference  # of the whole derivative


def compare(name: str, fine: Numbers, coarse: Numbers, interior: Numbers, total: Numbers) -> Group:
    """Return the group from functionals (seeds, k) by finite differences of two steps, without and with edges."""
    size = float(np.linalg.norm(fine.mean(0)))
    # What is 0 by finite differences has its derivative's own size
    scale = max(size, float(np.linalg.norm(total.mean(0)))) if size <= SIGMAS * _error(fine) else size

    def difference(x: Numbers) -> Difference:
        if scale == 0:
            return Difference(0.0, 0.0)
        return Difference(float(np.linalg.norm((x - fine).mean(0))) / scale, _error(x - fine) / scale)

    return Group(name, size, _error(fine), difference(coarse), difference(interior), difference(total))


def _error(x: Numbers) -> float:
    """Return the standard error of the mean of vectors (seeds, k)."""
    return float(np.linalg.norm(x.std(0, ddof=1))) / np.sqrt(len(x))


@dataclass(frozen=True, eq=False)
class Component:
    """The check of one number."""

    label: str
    value: float
    step: float  # half the distance of the finer central difference, in the parameter's unit
    groups: tuple[Group, ...]
    finite: Image  # derivative of the picture, mean of the seeds
    interior: Image
    total: Image

    def verdict(self, tolerance: float) -> tuple[Verdict, str]:
        """Return the verdict, and the figures that it rests on."""
        bad = max(self.groups, key=lambda g: g.steps.share)
        if any(g.steps.exceeds(tolerance) for g in self.groups):
            return "inconclusive", f"finite differences of two steps are {bad.steps} apart: try half the step"
        wrong = [g for g in self.groups if g.total.exceeds(tolerance)]
        if wrong:
            worst = max(wrong, key=lambda g: g.total.share)
            return "differs", f"by {worst.total} in {worst.name}"
        noisy = max(self.groups, key=lambda g: g.total.noise)
        if HIDES * noisy.total.noise > tolerance:
            return (
                "inconclusive",
                f"noise of {percent(noisy.total.noise)} in {noisy.name}: use more spp, seeds or boundary_samples",
            )
        worst = max(self.groups, key=lambda g: g.total.share)
        sure = worst.total.share + HIDES * worst.total.noise
        return "agrees", f"within {percent(max(sure, NOTHING) if sure else 0)}, of {percent(tolerance)} allowed"


@dataclass(frozen=True, eq=False)
class Report:
    """A derivative against finite differences."""

    parameter: str
    components: tuple[Component, ...]
    coverage: Coverage
    spp: int
    max_depth: int
    boundary_samples: int
    seeds: int
    tolerance: float

    @property
    def verdict(self) -> Verdict:
        """The worst of the components' verdicts."""
        verdicts = [component.verdict(self.tolerance)[0] for component in self.components]
        return "differs" if "differs" in verdicts else "inconclusive" if "inconclusive" in verdicts else "agrees"

    def __str__(self) -> str:
        samples = f"{self.spp} spp, max_depth {self.max_depth}, {self.boundary_samples} boundary samples"
        lines = [f"d(picture)/d({self.parameter}): {samples}, {self.seeds} seeds", ""]
        lines.append("  included     " + ", ".join(self.coverage.included))
        lines.append("  not covered  " + (", ".join(self.coverage.missing) or "nothing known"))
        for component in self.components:
            lines += ["", *_table(component, self.coverage.edges), _told(component, self.tolerance)]
        return "\n".join(lines)


def _table(component: Component, edges: bool) -> list[str]:
    head = f"{component.label} = {component.value:.6g}, step {component.step:.3g}"
    lines = [head, f"  {'':15s} {'finite difference':>22s}  {'twice the step':>20s}  {'interior only':>20s}"]
    lines[1] += f"  {'with edges':>20s}" if edges else ""
    for g in component.groups:
        line = f"  {g.name:15s} {g.size:>12.4g} ± {g.noise:<7.2g}  {g.steps!s:>20s}  {g.interior!s:>20s}"
        lines.append(line + (f"  {g.total!s:>20s}" if edges else ""))
    return lines


def _told(component: Component, tolerance: float) -> str:
    verdict, why = component.verdict(tolerance)
    return f"  {verdict}{':' if verdict == 'inconclusive' else ''} {why}"
