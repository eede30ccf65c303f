"""texsss: layered subsurface scattering in the texture space of a mesh."""

from importlib import import_module

_HOMES = {
    "AssetError": "errors",
    "Baked": "result",
    "Baker": "baker",
    "Cancelled": "errors",
    "ConvergenceError": "errors",
    "DomainError": "errors",
    "GaussianSum": "profiles.gaussians",
    "Layer": "media.stack",
    "Medium": "media.medium",
    "Scene": "scene",
    "ShapeError": "errors",
    "Stack": "media.stack",
    "TexsssError": "errors",
    "bake": "baker",
    "fit_gaussians": "profiles.fit",
    "hankel_profiles": "profiles.hankel",
    "preset": "media.presets",
    "render": "baker",
}

__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    """Public names on first use, so that reading a scene or a --help waits for no torch."""
    if name not in _HOMES:
        raise AttributeError(f"module 'texsss' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(f"texsss.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
