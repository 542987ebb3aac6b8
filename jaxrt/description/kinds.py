"""Kinds of things by name: one class each, from whose annotated fields all follows that others need to know of it.

    @material
    class Mirror:
        albedo: Albedo = (1.0, 1.0, 1.0)
        is_delta = True
        def sample(self, surface, wo, u): ...

makes the table `type = "mirror"` of the scene file, a pytree of arrays, one row a material, and the parameter
`materials.albedo` with its range. Names without annotation are statics, the same for all materials of the kind.
"""

import dataclasses
import difflib
import importlib
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError, WrapValidator, create_model
from pydantic.fields import FieldInfo

from jaxrt.core.messages import nearest, show
from jaxrt.description.textures import paintable, painted
from jaxrt.description.values import Count, Measure, Name, Table, complaint, measure_of, told

T = TypeVar("T")
RESERVED = {"type", "kind", "Table"}


class Kind(NamedTuple):
    """What is known of a kind."""

    name: str  # its type in scene files
    cls: Any  # pytree of rows, with the kind's behaviour
    table: type[Table]  # its table in scene files
    measures: dict[str, Measure]  # by field: its arrays
    settings: tuple[str, ...]  # other fields: part of the pytree's structure
    optional: frozenset[str] = frozenset()  # may be absent: None, and then no code; 0 where other rows are there

    @property
    def parameters(self) -> dict[str, Measure]:
        """The fields that derivatives can be taken of."""
        return {field: measure for field, measure in self.measures.items() if measure.range != "fixed"}

    @property
    def anchor(self) -> str | None:
        """The first of the fields that are places: where such a thing is."""
        return next((field for field, measure in self.measures.items() if measure.range == "place"), None)

    @property
    def place(self) -> str:
        """Where it is defined, for messages."""
        return f"{self.cls.__module__}.{self.cls.__qualname__}"

    def stack(self, tables: Sequence[Table], dtype: Any, origin: np.ndarray | float = 0.0) -> Any:
        """Return the kind's pytree with one row a table, leaves (n,) or (n, 3); places are counted from the origin."""
        import jax.numpy as jnp

        leaves = {}
        for field, measure in self.measures.items():
            given = [getattr(table, field) for table in tables]
            if all(value is None for value in given):
                continue
            nothing = np.zeros(measure.shape)
            values = np.asarray([nothing if value is None else value for value in given], float)
            leaves[field] = jnp.asarray(values - origin if measure.range == "place" else values, dtype)
        return self.cls(**leaves, **{name: getattr(tables[0], name) for name in self.settings})

    def single(self, table: Table, dtype: Any, origin: np.ndarray | float = 0.0) -> Any:
        """Return the kind's pytree of one table, without rows: leaves () or (3,)."""
        import jax

        return jax.tree.map(lambda leaf: leaf[0], self.stack([table], dtype, origin))


class Family:
    """All kinds of one sort of thing by name, ours first; used as a decorator, it adds one."""

    def __init__(
        self,
        word: str,
        owner: str,
        methods: Callable[[type], Sequence[str]],
        statics: Mapping[str, bool],
        *,
        default: str | None = None,
        rows: bool = True,
        shared: Mapping[str, tuple[Any, Any]] | None = None,
        named: bool = False,
        tried: bool = False,
        textured: bool = False,
    ) -> None:
        """Make an empty family.

        word: "material"; ours are in jaxrt.materials. owner: first part of its parameters' names. methods: what a class
        must have. statics: what a class may say, and what it says if it does not.
        default: the type of a table that names none. rows: whether there are many in a scene, as rows of arrays.
        shared: fields that all have, their type and default. named: whether a table may have a `name` for its row.
        tried: whether defaults and methods (see `contracts`) of classes that are not ours are tried.
        textured: whether fields that scale light may be textures.
        """
        self.word, self.owner, self.default = word, owner, default
        self._methods, self._statics, self._rows, self._shared = methods, statics, rows, shared or {}
        self._named: dict[str, Any] = {"name": (Name | None, None)} if named else {}
        self._tried, self._textured = tried, textured
        self._kinds: dict[str, Kind] = {}

    @dataclass_transform(frozen_default=True)
    def __call__(self, cls: type[T]) -> type[T]:
        """Return `cls` as a kind that scene files may name, by its name in snake_case.

        Raises TypeError for fields that are no numbers of `jaxrt.kinds`, for defaults out of their range, for methods
        that are missing, fail or return something else than they should, and for a name that is taken; a class of the
        same module and name is replaced.
        """
        from jaxrt.core.pytree import pytree, static

        if not isinstance(cls, type):
            raise TypeError(f"{self.word}: decorates a class: write @jaxrt.{self.word} above one")
        name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", cls.__name__).lower()
        for field in [field for field in self._shared if field not in get_type_hints(cls)]:
            cls.__annotations__[field], default = self._shared[field]
            setattr(cls, field, default)
        measures, settings, columns = self._fields(cls)
        hints = get_type_hints(cls, include_extras=True)
        optional = frozenset(field for field in measures if _given(hints[field])[1])
        # Those of its bases first, what may be absent last
        cls.__annotations__ = {field: hints[field] for field in sorted(hints, key=optional.__contains__)}
        base: Any = getattr(cls, "Table", Table)
        columns = {"type": (Literal[name], name), **self._named, **columns}
        table: Any = create_model(
            cls.__name__, __base__=base, __doc__=cls.__doc__, __module__=cls.__module__, **columns
        )
        for field in measures:  # rows have no defaults
            setattr(cls, field, dataclasses.field(default=None) if field in optional else dataclasses.field())
        for field in settings:
            setattr(cls, field, static())
        for key, value in self._statics.items():
            if not hasattr(cls, key):
                setattr(cls, key, value)
        self._check_statics(cls)
        missing = [method for method in self._methods(cls) if not callable(getattr(cls, method, None))]
        if missing:
            raise TypeError(f"{self.word} {cls.__qualname__}: has no method {missing[0]}: define it")
        kind = Kind(name, pytree(cls), table, measures, settings, optional)
        self._admit(kind)
        if self._is_tried(cls):
            from jaxrt.description.contracts import check_methods

            check_methods(self.word, kind, tuple(self._methods(cls)))
        kind.cls.Table, kind.cls.kind = table, kind
        self._kinds[name] = kind
        return kind.cls

    def _is_tried(self, cls: type) -> bool:
        return self._tried and not cls.__module__.startswith("jaxrt.")

    def _check_statics(self, cls: type) -> None:
        """Raise TypeError for what looks like a misspelt static."""
        for name, value in vars(cls).items():
            near = difflib.get_close_matches(name, self._statics, n=1, cutoff=0.8) if isinstance(value, bool) else []
            if near and name not in self._statics:
                raise TypeError(f"{self.word} {cls.__qualname__}: {name} says nothing (did you mean {near[0]}?)")

    def _fields(self, cls: type) -> tuple[dict[str, Measure], tuple[str, ...], dict[str, Any]]:
        """Return the measures of a class's arrays, its other fields, and all as columns of a table."""
        measures, settings, columns = {}, [], {}
        for field, hint in get_type_hints(cls, include_extras=True).items():
            if get_origin(hint) is ClassVar:
                continue
            given, is_optional = _given(hint)
            measure = measure_of(get_args(given)[1:])
            if field in RESERVED or field.startswith("_"):
                raise TypeError(f"{self.word} {cls.__qualname__}: {field} cannot be a field: name it otherwise")
            if measure is not None and not (is_optional and self._named):  # rows with names count all
                measures[field] = measure
            elif self._rows:
                raise TypeError(
                    f"{self.word} {cls.__qualname__}: {field} is no number with a range: annotate it with a type of "
                    "jaxrt.kinds, such as Albedo or Positive; for what all share leave the annotation out"
                )
            else:
                settings.append(field)
            default = getattr(cls, field, ...)
            plain = default is not ... and not isinstance(default, FieldInfo)
            if plain and measure is not None and self._is_tried(cls):
                self._check_default(cls, field, hint, default)
            can_be_textures = self._textured and not is_optional
            if measure is not None and can_be_textures and paintable(measure, getattr(cls, "is_delta", False)):
                hint = Annotated[hint, WrapValidator(partial(painted, measure))]
            columns[field] = (hint, Field(default=default, validate_default=True) if plain else default)
        return measures, tuple(settings), columns

    def _check_default(self, cls: type, field: str, hint: Any, default: Any) -> None:
        """Raise TypeError for a default that the field would not take."""
        try:
            TypeAdapter(hint).validate_python(default)
        except ValidationError as error:
            raise TypeError(f"{self.word} {cls.__qualname__}: default of {field}: {told(error)[0]}") from None

    def _admit(self, kind: Kind) -> None:
        """Raise TypeError where another kind has the name, or one of the parameters with another meaning."""
        for other in self.kinds.values():
            if other.name == kind.name and other.place != kind.place:
                raise TypeError(
                    f"{self.word} {kind.name}: is defined twice, by {_where(other.cls)} and {_where(kind.cls)}: "
                    "rename one of the classes"
                )
            for field in other.measures.keys() & kind.measures.keys() if other.name != kind.name else ():
                one, two = other.measures[field], kind.measures[field]
                if (one.range, one.axes) != (two.range, two.axes):
                    raise TypeError(
                        f"{self.word} {kind.name}: {field} is {two.range!r} of shape {two.shape}, but {one.range!r} of "
                        f"shape {one.shape} in {other.name} ({_where(other.cls)}): name it otherwise"
                    )

    @property
    def kinds(self) -> dict[str, Kind]:
        """All kinds by name: ours, then others in the order in which they were defined."""
        importlib.import_module(self.home)  # they are defined when somebody asks; afterwards this costs nothing
        return self._kinds

    @property
    def home(self) -> str:
        """The package in which ours are."""
        return f"jaxrt.{self.word}s"

    def load(self, *files: str) -> None:
        """Define our own kinds, each in a file of its package, in this order: that of their rows."""
        for file in files:
            importlib.import_module(f"{self.home}.{file}")

    @property
    def parameters(self) -> dict[str, Measure]:
        """Parameters by dotted name, of all kinds."""
        found: dict[str, Measure] = {}
        for kind in self.kinds.values():
            for field, measure in kind.parameters.items():
                found.setdefault(f"{self.owner}.{field}", measure)
        return found

    def kind_of(self, table: Any) -> Kind:
        """Return the kind of a validated table."""
        return self.kinds[table.type]

    def check_type(self, value: Mapping[Any, Any], *place: str | int) -> None:
        """Complain of a table that names no type, or one that is not known."""
        name = value.get("type", self.default)
        if name is None:
            raise complaint(f'"type" is missing: add type = {_choices(list(self.kinds))}', *place)
        if not isinstance(name, str) or name not in self.kinds:
            hint = nearest(name if isinstance(name, str) else show(name), self.kinds)
            raise complaint(f"unknown {self.word} type {show(name)}{hint}", *place, "type")

    def validate(self, value: Any) -> Table:
        """Return the validated table of the kind that a mapping names; complain, for pydantic, of what is wrong."""
        if isinstance(value, BaseModel):
            if isinstance(value, Table) and isinstance(value, tuple(kind.table for kind in self.kinds.values())):
                return value
            raise complaint(f"{show(value)} is no {self.word}: write keys and values")
        if not isinstance(value, Mapping):
            raise complaint(f"{show(value)} is not a table: write keys and values")
        self.check_type(value)
        try:
            return self.kinds[value.get("type", self.default)].table.model_validate(value)
        except ValidationError as error:
            text, place = told(error)
            raise complaint(text, *place) from None  # for the validator around


def _given(hint: Any) -> tuple[Any, bool]:
    """Return the type of a field where it is given, and whether it may be None instead."""
    others = [each for each in get_args(hint) if each is not NoneType]
    if get_origin(hint) in (Union, UnionType) and len(others) == 1 and NoneType in get_args(hint):
        return others[0], True
    return hint, False


def _choices(names: Sequence[str]) -> str:
    quoted = [show(name) for name in names]
    return " or ".join(filter(None, (", ".join(quoted[:-1]), quoted[-1])))


def _where(cls: type) -> str:
    """Return module, name, file and line of a class."""
    try:
        line = inspect.getsourcelines(cls)[1]
        return f"{cls.__module__}.{cls.__qualname__} ({inspect.getsourcefile(cls)}:{line})"
    except (OSError, TypeError):
        return f"{cls.__module__}.{cls.__qualname__}"


def _of_material(cls: Any) -> Sequence[str]:
    if cls.is_delta:
        return ("sample",)
    return ("sample", "evaluate", "numbers_toward") if hasattr(cls, "numbers_toward") else ("sample", "evaluate")


def _of_light(cls: Any) -> Sequence[str]:
    return ("sample",) if cls.is_delta else ("sample", "pdf", "emitted")


def _of_camera(cls: Any) -> Sequence[str]:
    if cls.is_central and "position" not in get_type_hints(cls) and not hasattr(cls, "position"):
        raise TypeError(
            f"camera {cls.__qualname__}: is central and has no position: make it a field, `position: Place`"
        )
    return ("ray", "project") if cls.is_central or cls.is_parallel else ("ray",)


MATERIALS = Family(
    "material",
    "materials",
    _of_material,
    {"is_delta": False, "is_lambertian": False, "transmits": False},
    tried=True,
    textured=True,
)
LIGHTS = Family("light", "lights", _of_light, {"is_delta": False}, default="sphere", named=True, tried=True)
CAMERAS = Family(
    "camera",
    "camera",
    _of_camera,
    {"is_central": False, "is_parallel": False},
    default="pinhole",
    rows=False,
    tried=True,
    shared={"width": (Count, 512), "height": (Count, 512)},
)
material, light, camera = MATERIALS, LIGHTS, CAMERAS
