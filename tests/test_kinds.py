"""Kinds: one annotated class makes a table, a pytree of rows, parameters; and what is refused of it."""

from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pydantic import BaseModel, BeforeValidator

from jaxrt.description.fields import Albedo, Ior, Place, Positive
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS, Family
from jaxrt.description.values import Count, Measure, Vector, require


@pytest.fixture
def family() -> Family:
    """A family of its own, whose package is the library's materials."""
    return Family("material", "materials", lambda cls: ("sample",), {"is_delta": False})


def plastic(family: Family):
    @family
    class SoftPlastic:
        """A test's plastic."""

        albedo: Albedo
        exponent: Annotated[Positive, require(lambda x: x <= 500, "is too sharp: use 500 or less")] = 20
        place: Place = (1, 2, 3)
        up: Annotated[Vector, Measure("fixed", "xyz", "[0, 1, 0]")] = (0, 1, 0)

        is_delta = True
        lobes = 2

        def sample(self):
            return self.exponent * self.lobes

    return SoftPlastic


def validated(family: Family, **table):
    class Holder(BaseModel):
        thing: Annotated[object, BeforeValidator(family.validate)]

    return Holder(thing=table).thing


def refused(family: Family, **table) -> tuple[tuple, str]:
    with pytest.raises(ValueError) as error:
        validated(family, **table)
    first = error.value.errors()[0]
    return first["ctx"]["place"], first["ctx"]["text"]


def test_a_class_makes_table_rows_and_parameters(family):
    made = plastic(family)
    tables = [validated(family, type="soft_plastic", albedo=[0.1, 0.2, 0.3], exponent=5)]
    tables.append(validated(family, type="soft_plastic", albedo=np.ones(3)))
    assert tables[1].exponent == 20 and isinstance(tables[1], made.Table) and made.Table.__doc__ == made.__doc__
    rows = family.kind_of(tables[0]).stack(tables, jnp.float32, np.array([1.0, 0, 0]))
    assert jax.tree.map(jnp.shape, rows) == made((2, 3), (2,), (2, 3), (2, 3))
    np.testing.assert_allclose(rows.place, [[0, 2, 3]] * 2)
    np.testing.assert_allclose(rows.sample(), [10, 40])
    assert all(leaf.dtype == jnp.float32 and not leaf.weak_type for leaf in jax.tree.leaves(rows))
    one = family.kind_of(tables[0]).single(tables[0], jnp.float32)
    assert one.exponent.shape == () and one.place.tolist() == [1, 2, 3]
    ranges = {name: (measure.range, measure.shape) for name, measure in made.kind.parameters.items()}
    assert ranges == {"albedo": ("fraction", (3,)), "exponent": ("positive", ()), "place": ("place", (3,))}


@pytest.mark.parametrize(
    ("table", "place", "text"),
    [
        ({}, (), '"type" is missing: add type = "hard_plastic" or "soft_plastic"'),
        ({"type": "soft_plastik"}, ("type",), 'unknown material type "soft_plastik" (did you mean "soft_plastic"?)'),
        ({"type": ["a"]}, ("type",), "unknown material type ['a'] (known: "),
        ({"type": "soft_plastic"}, (), '"albedo" is missing: add albedo = [0.8, 0.8, 0.8]'),
        (
            {"type": "soft_plastic", "albedo": [0, 2, 0]},
            ("albedo", 1),
            "2.0 is outside [0, 1]: choose an albedo within",
        ),
        ({"type": "soft_plastic", "albedo": [0, 0, 0], "exponent": 501}, ("exponent",), "501.0 is too sharp: use 500"),
        ({"type": "soft_plastic", "albedo": [0, 0, 0], "shine": 1}, (), 'unknown key "shine" (known: type, albedo, '),
        ({"type": "soft_plastic", "albedo": [0, 0, 0], "place": 1}, ("place",), "1 is not a list: write three values"),
    ],
)
def test_refused_tables(family, table, place, text):
    @family
    class HardPlastic:
        def sample(self): ...

    plastic(family)
    found = refused(family, **table)
    assert found[0] == place and found[1].startswith(text)


def test_the_same_class_again_replaces_and_another_of_its_name_is_refused(family):
    first = plastic(family)
    second = plastic(family)
    assert family.kinds["soft_plastic"].cls is second is not first

    class SoftPlastic:
        albedo: Albedo

        def sample(self): ...

    with pytest.raises(
        TypeError, match=r"material soft_plastic: is defined twice, by \S+ \(\S+\.py:\d+\) and \S+ \(\S+"
    ):
        family(SoftPlastic)


def test_classes_that_are_no_kinds(family):
    class NoMethod:
        albedo: Albedo

    class NoNumber:
        name: str

        def sample(self): ...

    class Type:
        type: Albedo

        def sample(self): ...

    class OtherMeaning:
        albedo: Positive

        def sample(self): ...

    plastic(family)
    for cls, text in (
        (NoMethod, r"^material \S*NoMethod: has no method sample: define it"),
        (NoNumber, r"^material \S*NoNumber: name is no number with a range: annotate it with a type of"),
        (Type, r"^material \S*Type: type cannot be a field: name it otherwise"),
        (
            OtherMeaning,
            r"^material other_meaning: albedo is 'positive' of shape \(\), but 'fraction' of shape \(3,\) in so",
        ),
    ):
        with pytest.raises(TypeError, match=text):
            family(cls)
        assert len(family.kinds) == 1


def test_names_and_settings():
    cameras = Family("camera", "camera", lambda cls: (), {}, default="hdr_lens2", rows=False)

    @cameras
    class HDRLens2:
        fov: Ior = 1.0
        width: Count = 4

    table = validated(cameras, width=8)
    assert table.type == "hdr_lens2"
    lens = cameras.kind_of(table).single(table, jnp.float32)
    assert lens.width == 8 and lens.fov.shape == () and len(jax.tree.leaves(lens)) == 1
    assert list(cameras.kinds["hdr_lens2"].parameters) == ["fov"]


def test_families_differ():
    assert len({family.home for family in (MATERIALS, LIGHTS, CAMERAS)}) == 3


def wrong(word, members):
    """Return a class of a kind of one's own, with an albedo and these members."""
    base = {"__module__": "mine", "__annotations__": {"albedo": Albedo} if word is MATERIALS else {}}
    return type("Wrong", (), base | members)


def up(*_):
    return jnp.array([0.0, 1.0, 0.0])


def pair(*_):
    return up(), up()


DELTA = {"is_delta": True}


@pytest.mark.parametrize(
    ("family", "members", "text"),
    [
        (MATERIALS, {"sample": pair, "evaluate": up}, r"evaluate returns \(3,\), want \(f cosθ \(3,\), pdf \(\)\)"),
        (MATERIALS, {"sample": pair, "evaluate": lambda *_: None}, r"evaluate returns None, want \(f cosθ"),
        (MATERIALS, {"sample": pair, "evaluate": pair}, r"evaluate returns \(\(3,\), \(3,\)\), want"),
        (
            MATERIALS,
            {"sample": pair, "evaluate": lambda *_: (up(), 1)},
            r"evaluate returns \(\(3,\), int32 \(\)\)",
        ),
        (
            MATERIALS,
            {"sample": lambda *_: (up(), 0.5)} | DELTA,
            r"sample returns \(\(3,\), \(\)\), want \(wi",
        ),
        (MATERIALS, {"sample": lambda self, wo, u: wo} | DELTA, r"sample fails: TypeError: .*3 positional arguments"),
        (MATERIALS, {"sample": lambda self, s, wo, u: self.albdo} | DELTA, r"sample fails: AttributeError: .*albdo"),
        (MATERIALS, {"sample": pair, "is_dleta": True}, r"is_dleta says nothing \(did you mean is_delta\?\)"),
        (MATERIALS, {"albedo": (2, 0, 0), "sample": pair} | DELTA, r"default of albedo: 2.0 is outside \[0, 1\]"),
        (MATERIALS, {"albedo": 0.5, "sample": pair} | DELTA, r"default of albedo: 0.5 is not a list"),
        (LIGHTS, {"sample": pair} | DELTA, r"sample returns \(\(3,\), \(3,\)\), want \(direction \(3,\), distance"),
        (
            LIGHTS,
            {"sample": up, "pdf": lambda *_: 0.1, "emitted": lambda *_: 1.0},
            r"emitted returns \(\), want",
        ),
        (CAMERAS, {"ray": pair}, r"ray returns \(\(3,\), \(3,\)\), want Ray\(origin"),
    ],
)
def test_methods_that_answer_otherwise_are_refused_with_their_name(family, members, text):
    known = dict(family.kinds)
    with pytest.raises(TypeError, match=rf"^{family.word} Wrong: {text}"):
        family(wrong(family, members))
    assert family.kinds == known


def test_what_is_no_class_is_refused():
    with pytest.raises(TypeError, match="^material: decorates a class: write @jaxrt.material above one"):
        MATERIALS(up)
