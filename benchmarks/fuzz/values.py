"""A valid scene file key by key, and for each kind of key values that it must refuse, as they stand in TOML."""

BOX = """\
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""

# Table, key, valid value, kind of value, whether the key must be there
KEYS = [
    ("[camera]", "position", "[0, 0, 5]", "place", True),
    ("[camera]", "target", "[0, 0, 0]", "place", False),
    ("[camera]", "up", "[0, 1, 0]", "place", False),
    ("[camera]", "fov", "60", "fov", False),
    ("[camera]", "width", "8", "count", False),
    ("[camera]", "height", "8", "count", False),
    ("[camera]", "roll", "5", "angle", False),
    ("[camera]", "rotate", "[0, 5, 0]", "angles", False),
    ("[render]", "spp", "4", "count", False),
    ("[render]", "max_depth", "3", "count", False),
    ("[environment]", "radiance", "[0.1, 0.2, 0.3]", "light", True),
    ("[materials.white]", "type", '"diffuse"', "type", True),
    ("[materials.white]", "albedo", "[0.8, 0.8, 0.8]", "albedo", True),
    ("[materials.silver]", "type", '"mirror"', "type", True),
    ("[materials.silver]", "albedo", "[0.9, 0.9, 0.9]", "albedo", False),
    ("[materials.ball]", "type", '"glass"', "type", True),
    ("[materials.ball]", "ior", "1.5", "ior", True),
    ("[[spheres]]", "center", "[0, 0, 0]", "place", True),
    ("[[spheres]]", "radius", "1", "radius", True),
    ("[[spheres]]", "material", '"ball"', "name", True),
    ("[[triangles]]", "vertices", "[[0, 0, 0], [1, 0, 0], [0, 1, 0]]", "corners", True),
    ("[[triangles]]", "material", '"white"', "name", True),
    ("[[meshes]]", "file", '"box.obj"', "file", True),
    ("[[meshes]]", "material", '"white"', "name", True),
    ("[[meshes]]", "scale", "2", "scale", False),
    ("[[meshes]]", "rotate", "[0, 90, 0]", "angles", False),
    ("[[meshes]]", "translate", "[0, 0, -3]", "place", False),
    ("[[meshes]]", "smooth", "true", "truth", False),
    ("[[meshes]] ", "vertices", "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]", "vertices", True),
    ("[[meshes]] ", "faces", "[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]", "faces", True),
    ("[[meshes]] ", "material", '"silver"', "name", True),
    ("[[lights]]", "position", "[0, 4, 5]", "place", True),
    ("[[lights]]", "intensity", "[9, 9, 9]", "power", True),
    ("[[lights]]", "radius", "0.5", "light radius", False),
]
TABLES = list(dict.fromkeys(table for table, *_ in KEYS))

# fmt: off
HUGE = ["0x" + "f" * 5000, "9" * 5000, "0b" + "1" * 20_000, "9" * 400, "0o" + "7" * 3000]
NEST = "[" * 60 + "1" + "]" * 60
GIANT = f"[{', '.join(['1'] * 20_000)}]"
TABLE_VALUES = ["{}", "{a = 1}", "{a.b.c = 1}", "{x = {y = {z = 1}}}"]
DATES = ["1979-05-27", "07:32:00", "1979-05-27T07:32:00Z"]
BEYOND = ["nan", "+nan", "-nan", "inf", "-inf", "1e999", "-1e999", "1e39", "-1e39"]
TEXTS = ["'5'", '""', "'''\n5'''", '"[1, 2, 3]"', '"nan"', '"\\u001b[31m"', '"\\u202e"', '"😀"', f'"{"x" * 10_000}"']
NOT_NUMBERS = ["true", *TEXTS, *DATES, *TABLE_VALUES, *BEYOND, *HUGE, NEST, "[]", "[[]]"]
ODD = [*HUGE, *DATES, *TABLE_VALUES, NEST, "nan", "5", "[]"]  # neither names nor truth values
ODD_ARRAYS = [*TABLE_VALUES, *HUGE, NEST, GIANT, "5", '"abc"', "true", "[]", "[[]]"]

BAD_NUMBERS = {
    "place": ["1e16", "-1e16", "3e38"],
    "albedo": ["-0.001", "1.001", "255", "-1e-30"],
    "light": ["-1", "-1e-30", "1e31", "3e38"],
    "power": ["-1", "1e31", "3e38"],
    "fov": ["0", "-0.0", "-60", "180", "179.99999999", "1e-200", "5e-324"],
    "count": ["0", "-1", "1.5", "1.0", "1e3", "2147483648", "-9223372036854775808"],
    "radius": ["0", "-0.0", "-1", "1e-200", "5e-324", "1e-16", "1e16", "3e38"],
    "light radius": ["-1", "-1e-200", "1e-200", "1e-16", "1e16"],
    "ior": ["0", "-1.5", "1e-200"],
    "scale": ["0", "-1", "1e-200", "1e-60", "1e30"],
    "angle": [],
    "angles": [],
}
VECTORS = {"place", "albedo", "light", "power", "angles"}
WRONG_LENGTHS = ["[1]", "[1, 2]", "[0.1, 0.1, 0.1, 0.1]", "[[0, 0, 0], [0, 0, 0], [0, 0, 0]]", "[[0], [0], [0]]", GIANT]

BAD_VALUES = {
    "type": [*ODD, '"glas"', '"Diffuse"', '"diffuse "', '""', "true", '["diffuse"]'],
    "name": [
        *ODD, '"whit"', '"WHITE"', '"white "', '""', "true", '["white"]', '"wh\\u0000ite"', f'"{"w" * 10_000}"',
        '"\\u001b[31m"', '"белый"',
    ],
    "truth": [*ODD, "0", "1", "1.0", '"true"', '""', "[true]"],
    "file": [
        *ODD, "true", '"nowhere.obj"', '"box.stl"', '"box"', '"box.xyz"', '"."', '".."', '""', '"/"', '"pipe.obj"',
        '"zero.obj"', '"loop.obj"', '"out.obj"', '"folder.obj"', '"empty.obj"', '"/dev/zero"', '"/dev/stdin"',
        '"/etc/passwd"', '"../../../../../../etc/hosts.obj"', '"box.obj\\u0000"', f'"{"x" * 5000}.obj"',
        f'"{"x/" * 3000}a.obj"', '"nowhere/box.obj"', '"box.obj/box.obj"', '"\\n.obj"',
    ],
    "corners": [
        *ODD_ARRAYS, "[[0, 0, 0]]", "[[0, 0, 0], [1, 0, 0]]", "[[0, 0], [1, 0], [0, 1]]",
        "[[0, 0, 0], [1, 0, 0], [2, 0, 0]]", "[[0, 0, 0], [0, 0, 0], [0, 1, 0]]", "[[0, 0, 0], [1, 0, 0], [0, nan, 0]]",
        "[[0, 0, 0], [1, 0, 0], [0, 1e16, 0]]", "[[0, 0, 0], [1e-30, 0, 0], [0, 1e-30, 0]]",
        "[['a', 0, 0], [1, 0, 0], [0, 1, 0]]",
    ],
    "vertices": [
        *ODD_ARRAYS, "[[0, 0]]", "[[0, 0, 0], [1, 0]]", "[[nan, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        "[[1e39, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[['a', 'b', 'c']]", "[[true, false, true]]",
        "[[0, 0, 0], [1, 0, 0], [0, 1, 0]]", "[[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]", "[[1979-05-27, 0, 0]]",
        f"[[{HUGE[0]}, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        f"[[{HUGE[3]}, 0.5, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]",
    ],
    "faces": [
        *ODD_ARRAYS, "[[0, 1]]", "[[0, 1, 4]]", "[[0, 1, -1]]", "[[0.0, 1.0, 2.0]]", "[[0, 1, 2], [0, 1]]",
        "[[0, 1, nan]]",
        "[['0', '1', '2']]", "[[true, false, true]]", "[[0, 0, 0]]", f"[[0, 1, {HUGE[0]}]]",
        "[[0, 1, 9223372036854775808]]",
        "[[0, 1, -9223372036854775809]]", "[[0, 1, 18446744073709551616]]",
    ],
}
