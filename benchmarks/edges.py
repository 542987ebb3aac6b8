"""Derivatives of everything that moves an edge against finite differences, each beside its bound.

    python -m benchmarks.edges [--rows NAME...] [--list] [--references FILE [--prepare]] [--draw FOLDER]
    python -m benchmarks.edges --tables [--output docs/derivatives.png] [--peer-python PATH]
    python -m benchmarks.edges --peer-configurations [--peer-python PATH]
    python -m benchmarks.edges --cost
    python -m benchmarks.edges --fits

Prints a row for each: the error, what of it can be noise, its bound, the error without edges, and the noise after one
CPU second. `--references` keeps finite differences in a file, so that only estimates are made anew; `--prepare` makes
these and no more. `--draw docs` measures what docs/derivatives.md shows, and draws it: of `--rows`, sheets that these
fill. `--tables`: moving shadows and outlines by the number of samples, beside Mitsuba, and the pictures.
`--peer-configurations`: Mitsuba's own tests. `--cost`: gradients in renders. `--fits`: from how many starts what shows
by its edges is found.
Without `--rows` come besides what must not change: pictures, and programs of derivatives that move nothing of the kind.
Exit status 1 where something does not hold.
"""

import argparse
import sys
from pathlib import Path

import jax

from benchmarks import edge_cost, edge_fits, edge_peer, edge_pictures, edge_same, edge_tables
from benchmarks.edge_rows import References, Result, measure
from benchmarks.edge_scenes import Row, rows
from benchmarks.processes import cpu_model, wide_console

HEAD = f"{'d/d':<52}{'error':>8}{'own noise':>11}{'FD noise':>10}{'FD step':>9}{'bound':>7}{'seeds':>7}"
HEAD += f"{'inside':>8}{'FD keys':>9}{'interior':>10}{'in 1 CPU s':>12}"


def arguments() -> argparse.Namespace:
    """Return the command line's options."""
    parser = argparse.ArgumentParser(description="Derivatives of moving edges against finite differences.")
    parser.add_argument("--rows", nargs="+", metavar="NAME", help="those with one of these in their names")
    parser.add_argument("--list", action="store_true", help="print the rows' names, and no more")
    parser.add_argument("--references", type=Path, metavar="FILE", help="keep finite differences in this .npz file")
    parser.add_argument("--prepare", action="store_true", help="make the references, and no more")
    parser.add_argument("--draw", type=Path, metavar="FOLDER", help="only whole sheets of pictures; save these there")
    parser.add_argument("--keys", type=int, default=256, help="of finite differences, at most")
    parser.add_argument("--seeds", type=int, default=256, help="of edges, at most; inside of them 32 times as many")
    parser.add_argument("--cost", action="store_true", help="what gradients cost, and no more")
    parser.add_argument("--fits", action="store_true", help="what is found by edges, and no more")
    parser.add_argument("--peer-configurations", action="store_true", help="those of Mitsuba's tests, and no more")
    parser.add_argument("--tables", action="store_true", help="tables by the number of samples, and the pictures")
    edge_tables.add_options(parser)
    return parser.parse_args()


def line(found: Result) -> str:
    """Return a row of the table."""
    shares = f"{found.error:8.4f}{found.noise:11.4f}{found.fd_noise:10.4f}{found.step:9.4f}{found.row.bound:7.2f}"
    shares += f"{found.seeds[0]:7}{found.seeds[1]:8}{found.keys:9}{found.interior:10.3f}{found.second:12.4f}"
    return f"{found.row.name:<52}{shares}  {found.word}"


def measured(chosen: list[Row], references: References, seeds: int) -> list[Result]:
    """Print the table, each row as soon as it is known, and return what is found."""
    print(HEAD)
    results = []
    for row in chosen:
        results.append(measure(row, references, seeds))
        print(line(results[-1]), flush=True)
    return results


def main() -> int:
    """Print what is asked for; return 1 where something does not hold."""
    options = arguments()
    chosen = [row for row in rows() if not options.rows or any(name in row.name for name in options.rows)]
    if options.draw:
        names = [name for sheet in edge_pictures.whole(chosen) for name in edge_pictures.SHEETS[sheet]]
        chosen = [row for row in chosen if row.name in names]
        if not chosen:
            print("--draw: --rows leaves out some of each sheet's rows; name all of one, or none", file=sys.stderr)
            return 2
    console = wide_console()
    if options.list:
        print(*(row.name for row in chosen), sep="\n")
        return 0
    console.print(f"{cpu_model()}; jax {jax.__version__}")
    if options.tables:
        return edge_tables.main(options, console)
    if options.peer_configurations:
        return edge_peer.main(options, console)
    if options.cost:
        return edge_cost.main(console)
    if options.fits:
        return edge_fits.main(console)
    references = References(options.references, options.keys)
    if options.prepare:
        for row in chosen:
            console.print(row.name, len(references.of(row).near))
        return 0
    results = measured(chosen, references, options.seeds)
    if options.draw:
        edge_pictures.draw(options.draw, results)
    held = all(found.word == "holds" for found in results)
    return int(not (held and (bool(options.rows or options.draw) or edge_same.holds(console))))


if __name__ == "__main__":
    sys.exit(main())
