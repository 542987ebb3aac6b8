"""Stages of a native kernel: functions whose results are computed once and kept, forwards and backwards.

Without them XLA's CPU backend computes a value anew in each operation that uses it, and their number multiplies.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr, Primitive, Var, jaxpr_as_fun

from jaxrt.kernels.internals import Zero, operation

Variables = dict[Var, None]

MOST = 600  # numbers of a lane: XLA divides an operation of 900 on 128 lanes among threads, which no native kernel can


def stage(f: Callable[..., Any]) -> Callable[..., Any]:
    """Return f as a call that is compiled by itself; its transpose is another."""
    call = tagged(f)
    return lambda *operands: call(*jax.tree.map(_entering, operands))


def stages(f: Callable[..., Any]) -> Callable[..., Any]:
    """Return f as a stage, or as several where it computes more than `MOST` numbers."""

    def staged(*operands: Any) -> Any:
        program, shape = jax.make_jaxpr(f, return_shape=True)(*operands)
        if sum(map(_size, program.jaxpr.eqns)) <= MOST:
            return stage(f)(*operands)
        results = _one_after_the_other(program, jax.tree.leaves(operands))
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    return staged


def tagged(f: Callable[..., Any]) -> Callable[..., Any]:
    """Return f as a call that XLA's CPU backend compiles as one native function."""
    call = jax.jit(f)
    return lambda *operands: _tag(call(*operands))


def _tag(results: Any) -> Any:
    return set_xla_metadata(results, xla_cpu_small_call="true", inlineable="false")


def _one_after_the_other(program: ClosedJaxpr, operands: Sequence[Any]) -> list[Any]:
    """Return the program's results, computed by calls of at most about `MOST` numbers."""
    jaxpr = program.jaxpr
    known = dict(zip((*jaxpr.constvars, *jaxpr.invars), (*program.consts, *operands), strict=True))

    def value(v: Any) -> Any:
        return known[v] if isinstance(v, Var) else v.val

    for part, wanted in _parts(_needed(jaxpr), _variables(jaxpr.outvars)):
        if _size(part[0]) > MOST and part[0].primitive.name in ("jit", "pjit"):
            f = stages(jaxpr_as_fun(part[0].params["jaxpr"]))
            given, results = part[0].invars, part[0].outvars
        else:
            made = _variables(v for e in part for v in e.outvars)
            given = [v for v in _variables(v for e in part for v in e.invars) if v not in made]
            results = [v for v in made if v in wanted]
            names = jaxpr.debug_info.with_unknown_names()
            one = jaxpr.replace(constvars=(), invars=given, outvars=results, eqns=part, debug_info=names)
            f = stage(jaxpr_as_fun(ClosedJaxpr(one, ())))
        known.update(zip(results, f(*map(value, given)), strict=True))
    return [value(v) for v in jaxpr.outvars]


def _parts(equations: list[Any], wanted: Variables) -> list[tuple[list[Any], Variables]]:
    """Return the equations in groups, each with what is wanted of it and those before. wanted: the results."""
    groups: list[list[Any]] = []
    size = MOST
    for equation in equations:
        if size + _size(equation) > MOST:
            groups.append([])
            size = 0
        groups[-1].append(equation)
        size += _size(equation)
    parts: list[tuple[list[Any], Variables]] = []
    for group in reversed(groups):
        parts.insert(0, (group, wanted))
        wanted = wanted | _variables(v for e in group for v in e.invars)
    return parts


def _needed(jaxpr: Jaxpr) -> list[Any]:
    """Return the equations that results depend on."""
    wanted, needed = _variables(jaxpr.outvars), list[Any]()
    for equation in reversed(jaxpr.eqns):
        if any(v in wanted for v in equation.outvars):
            needed.insert(0, equation)
            wanted |= _variables(equation.invars)
    return needed


def _variables(atoms: Any) -> Variables:
    """Return the variables among numbers and variables, each once and in order."""
    return dict.fromkeys(v for v in atoms if isinstance(v, Var))


def _size(equation: Any) -> int:
    """Return how many numbers an equation computes, with those of what it calls; at least 1."""
    inner = [getattr(p, "jaxpr", p) for p in equation.params.values()]
    called = sum(_size(e) for jaxpr in inner if isinstance(jaxpr, Jaxpr) for e in jaxpr.eqns)
    return called or max([1, *(v.aval.size for v in equation.outvars)])


def _entering(x: Any) -> Any:
    """Return what goes into a stage. What comes out of it backwards is tagged, so that the transpose is a stage too."""
    return _enter.bind(x) if jnp.issubdtype(jnp.result_type(x), jnp.floating) else x


def _same(x: Array) -> Array:
    return x


def _differentiate(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Array, Any]:
    change = tangents[0]
    return _enter.bind(*primals), change if type(change) is Zero else _enter.bind(change)


def _transpose(cotangent: Any, _: Any) -> list[Any]:
    return [cotangent if type(cotangent) is Zero else _tag(cotangent)]


_enter: Primitive = operation(
    "enter_stage", _same, _same, lambda xs, axes: (_enter.bind(*xs), axes[0]), _differentiate, _transpose, several=False
)
