"""Packages that not every installation has. Nothing here loads them."""

from importlib.util import find_spec

from jaxrt.core.messages import SceneError


class MissingExtra(SceneError, ImportError):
    """Something that needs packages which are not installed."""


def require(extra: str, *packages: str) -> None:
    """Raise MissingExtra, one line with the remedy, unless the packages of that extra are there."""
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        raise MissingExtra(f"{extra}: {', '.join(missing)} {are} not installed: pip install 'jaxrt[{extra}]'")
