"""Run renderers in child processes, so that start-up, compilation and peak memory are each renderer's own."""

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

HERE = Path(__file__).parent
PROJECT = HERE.parent
PEER_VARIABLE = "JAXRT_MITSUBA_PYTHON"
PROBE = """
import drjit, mitsuba
mitsuba.set_variant("llvm_ad_rgb")
drjit.eval(mitsuba.Float([1, 2]) + 1)
print(mitsuba.__version__)
"""


@dataclass(frozen=True)
class Finished:
    """What a child process has cost, and its standard output."""

    seconds: float  # wall time from start to exit
    peak_bytes: int  # largest resident set
    output: str


def run_child(command: list[str], cache: str) -> Finished:
    """Run `command` with all compilation caches in the folder `cache`.

    Raises RuntimeError with the child's messages if it fails. Keep the calling process small: Linux counts
    its resident set into the child's peak.
    """
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": cache, "DRJIT_CACHE_DIR": f"{cache}/drjit"}
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as errors:
        start = time.perf_counter()
        child = subprocess.Popen(command, stdout=output, stderr=errors, env=environment, cwd=PROJECT)
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        errors.seek(0)
        if child.returncode:
            raise RuntimeError(f"{' '.join(command)}: exit status {child.returncode}\n{errors.read()}")
        kilobyte = 1 if sys.platform == "darwin" else 1024
        return Finished(seconds, usage.ru_maxrss * kilobyte, output.read())


def report_of(finished: Finished) -> dict[str, Any]:
    """Return the JSON object on the last line of a side script's output."""
    return json.loads(finished.output.strip().splitlines()[-1])


def flags(**options: object) -> list[str]:
    """Return `--name value` for each option that is not None: max_depth=4 becomes --max-depth 4."""
    given = {name: value for name, value in options.items() if value is not None}
    return [word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", str(value))]


def jaxrt_side(command: str, scene: str, **options: object) -> list[str]:
    """Return the command line of jaxrt's half."""
    return [sys.executable, "-m", "benchmarks.jaxrt_side", command, scene, *flags(**options)]


def peer_side(python: str, command: str, scene: str, **options: object) -> list[str]:
    """Return the command line of Mitsuba's half, in Mitsuba's own environment."""
    return [python, str(HERE / "mitsuba_side.py"), command, scene, *flags(**options)]


def find_peer(python: str | None) -> tuple[str | None, str]:
    """Return (python with a working Mitsuba or None, its version or the reason why there is none)."""
    python = python or os.environ.get(PEER_VARIABLE)
    remedy = "see benchmarks/README.md for how to make the peer environment"
    if not python:
        return None, f"Mitsuba skipped: neither --peer-python nor {PEER_VARIABLE} is set; {remedy}"
    try:
        answer = subprocess.run([python, "-c", PROBE], capture_output=True, text=True)
    except OSError as error:
        return None, f"Mitsuba skipped: {python}: {error.strerror}; {remedy}"
    if answer.returncode:
        reason = (answer.stderr.strip().splitlines() or ["no message"])[-1]
        return None, f"Mitsuba skipped: {python}: {reason}; {remedy}"
    return python, f"Mitsuba {answer.stdout.strip()} llvm_ad_rgb"


def wide_console() -> Console:
    """Return a console that is wide enough for the tables where the output is no terminal."""
    return Console() if sys.stdout.isatty() else Console(width=140)


def cpu_model() -> str:
    """Return the processor's name and the number of cores."""
    name = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        lines = information.read_text().splitlines()
        found = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        wide = "AVX-512" if "avx512f" in information.read_text() else "no AVX-512"
        name = f"{found[0] if found else name} ({wide})"
    return f"{name}, {os.cpu_count()} cores"


def ratio_text(ours: list[float], theirs: list[float]) -> str:
    """Return 'median (least–most)' of the ratios ours / theirs within each round."""
    if min(map(abs, theirs)) < 0.02:
        return "peer too short to tell"
    ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
    return f"{statistics.median(ratios):.2f} ({min(ratios):.2f}–{max(ratios):.2f})"
