"""From how many of 20 starts does a fit end where the picture was made, by edges alone or nearly so?

A ball is placed by its soft shadow, its own outline being outside the picture; a lamp by what a mirror ball shows of it
and by its light; a glass ball, and what it bends light by, by what is seen through it: under a sky, a cloth of colours.
Of lamps it would make caustics, which light samples cannot find: a few pixels then hold most of the noise. Starts lie
within a fifth of the scene's size of the truth. Found is what ends within 1 % of that size, and an index of refraction
within .01.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import jaxrt
from benchmarks.edge_scenes import BEFORE, GROUND, LAMP, Description, ball, quad, scene
from benchmarks.ladder import build
from jaxrt.fit import Machine, Problem, sought
from jaxrt.fit.answer import answer_of
from jaxrt.fit.descent import descend

SIZE, SPP, TARGET_SPP = 40, 128, 4096
STARTS = 20
TEXELS = 6  # of the cloth, along each side
SHARE, NEAR = 1 / 5, 1 / 100  # of the scene's size: how far starts are, how near answers
IOR, NEAR_IOR = 0.1, 0.01


class Task(NamedTuple):
    """What is sought from which picture."""

    name: str
    description: Description
    parameters: tuple[str, ...]  # the first is a place
    size: float  # of the floor, from mirror to lamp, across what is seen of the glass ball's surroundings
    depth: int


def tasks() -> list[Task]:
    """Return the tasks."""
    above = {"position": [0, 0.8, 0.8], "target": [0, 0, 0.2], "fov": 60}
    floor = quad([-2, 0, -2.5], [0, 0, 4], [4, 0, 0], "grey")
    shaded = scene(above, sky=1, spheres=[ball("ball", "grey", [0, 1.7, 0], 0.6)], triangles=floor)
    near, lamp = {"position": [0, 2, 3.5], "target": [0, 1.2, -1], "fov": 35}, LAMP | {"radius": 1.2}
    mirrored = scene(near, spheres=[ball("mirror", "mirror", [0, 1.2, -1], 1.2), GROUND], lights=[lamp])
    bent = scene(BEFORE, sky=1, spheres=[ball("glass", "glass", [0, 1.2, 3], 0.6)])
    return [
        Task("a ball by its shadow from the sky", shaded, ("spheres.center[ball]",), 5.6, 1),
        Task("a lamp by its image in a mirror ball", mirrored, ("lights.position[0]",), 6.6, 2),
        Task("a glass ball and its ior", over_cloth(bent), ("spheres.center[glass]", "materials.ior[0]"), 3.3, 4),
    ]


def over_cloth(description: Description) -> Description:
    """Return the scene over a cloth of 8 by 10 that is painted in soft patches of chance colours."""
    texels = np.random.default_rng(5).uniform(0.1, 0.9, (TEXELS, TEXELS, 3)).tolist()
    cloth = {"vertices": [[-4, 0, 6], [4, 0, 6], [4, 0, -4], [-4, 0, -4]], "faces": [[0, 1, 2], [0, 2, 3]]}
    painted = {"cloth": {"type": "diffuse", "albedo": "paint"}}
    return description | {
        "textures": {"paint": {"texels": texels, "wrap": "clamp"}},
        "materials": description["materials"] | painted,
        "meshes": [cloth | {"uv": [[0, 0], [1, 0], [1, 1], [0, 1]], "material": "cloth"}],
    }


def moved(task: Task, here: jaxrt.Scene, rng: np.random.Generator) -> jaxrt.Scene:
    """Return the scene at another start."""
    away = rng.normal(size=3)
    away *= SHARE * task.size * rng.uniform() ** (1 / 3) / np.linalg.norm(away)
    moves = {task.parameters[0]: away}
    moves |= {name: rng.uniform(-IOR, IOR) for name in task.parameters[1:]}
    for name, move in moves.items():
        value = jaxrt.parameters(here, name)
        here = jaxrt.with_parameters(here, {name: value + jnp.asarray(move, value.dtype).reshape(value.shape)})
    return here


def is_found(task: Task, truth: jaxrt.Scene, answer: jaxrt.Scene) -> bool:
    """Return whether all that is sought is where it was."""
    off = [np.linalg.norm(jaxrt.parameters(answer, name) - jaxrt.parameters(truth, name)) for name in task.parameters]
    return bool(off[0] <= NEAR * task.size and all(x <= NEAR_IOR for x in off[1:]))


def fits(task: Task) -> list[tuple[bool, str]]:
    """Return of each start whether its end is the truth, and the verdict."""
    truth = build(task.description, width=SIZE, height=SIZE)
    target = jaxrt.render(truth, 1000, spp=TARGET_SPP, max_depth=task.depth)
    unknowns, rng, found = sought(truth, task.parameters), np.random.default_rng(0), []
    program = Machine(Problem(truth, unknowns, target, jnp.ones(1), task.depth))
    for number in range(STARTS):
        start = moved(task, truth, rng)
        machine = program.again(start)
        answer = answer_of(start, machine.problem, descend(machine, SPP, number), {})
        found.append((is_found(task, truth, answer.scene), answer.verdict.word))
        print(f"{task.name}, start {number}: {'found' if found[-1][0] else 'elsewhere'}, {found[-1][1]}", flush=True)
    return found


def main(console: Console) -> int:
    """Print the table; return 1 where too few are found, or a wrong one is called solved."""
    table = Table("sought", "found", "called solved", "found, and so called", "wrong, and called solved")
    good = True
    for task in tasks():
        ends = fits(task)
        right, solved = (np.asarray([x[0] for x in ends]), np.asarray([x[1] == "solved" for x in ends]))
        good &= right.sum() >= 0.8 * STARTS and not (solved & ~right).any()
        table.add_row(task.name, *(str(int(x.sum())) for x in (right, solved, right & solved, solved & ~right)))
    console.print(table)
    return int(not good)
