"""Files in and out: scene files, meshes and pictures."""

import jax.numpy as jnp
from jax.typing import DTypeLike

from jaxrt.core.examples import example_file
from jaxrt.io.files import StrPath
from jaxrt.io.folders import Folders
from jaxrt.io.image import load_image, save_image
from jaxrt.io.meshes import load_mesh
from jaxrt.io.scene_file import read_description
from jaxrt.io.textures import load_texture
from jaxrt.scene import Scene, build
from jaxrt.scene.build import views_of

__all__ = [
    "example",
    "load_image",
    "load_mesh",
    "load_scene",
    "load_texture",
    "load_views",
    "read_description",
    "save_image",
]


def load_scene(path: StrPath, dtype: DTypeLike = jnp.float32, allow_folders: Folders = ()) -> Scene:
    """Return the scene in the TOML file at `path`.

    Errors, warnings, `dtype`: as for `jaxrt.build`. allow_folders: from where its meshes and their materials may come
    besides the folder above the file's and all below that.
    """
    return build(read_description(path, allow_folders), dtype)


def load_views(path: StrPath, dtype: DTypeLike = jnp.float32, allow_folders: Folders = ()) -> tuple[Scene, ...]:
    """Return for each of the `[[cameras]]` in the TOML file at `path` the scene that it sees; the rest is shared.

    A file with one `[camera]` has one view. The arguments, and what is raised, are those of `load_scene`, which returns
    the first.
    """
    description = read_description(path, allow_folders)
    return views_of(build(description, dtype), description)


def example(name: str, dtype: DTypeLike = jnp.float32) -> Scene:
    """Return a scene that comes with jaxrt, such as "room"; `jaxrt example` lists them and writes their files.

    Raises SceneError for a name that there is not. `dtype`: as for `jaxrt.build`.
    """
    return load_scene(example_file(name), dtype)
