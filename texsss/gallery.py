"""The scenes that texsss ships, by name."""

from importlib.resources import files

from texsss.errors import AssetError
from texsss.scene import Scene


def names() -> list[str]:
    """Names of the shipped scenes, sorted."""
    return sorted(_found())


def scene(name: str) -> Scene:
    """A shipped scene. Raises AssetError: for another name; the choices are listed."""
    found = _found()
    if name not in found:
        raise AssetError(
            f"Scene: expected one of {', '.join(sorted(found))}, got {name!r}; choose one of them."
        )
    return Scene.load(found[name])


def _found() -> dict:
    folder = files("texsss_assets").joinpath("scenes")
    return {item.name.removesuffix(".json"): item for item in folder.iterdir() if item.name.endswith(".json")}
