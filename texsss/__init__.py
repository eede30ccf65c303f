"""texsss: layered subsurface scattering in the texture space of a mesh."""

from importlib import import_module

_HOMES = {
    "AssetError": "errors",
    "Baked": "result",
    "Baker": "baker",
    "Burley": "profiles.burley",
    "Cancelled": "errors",
    "ConvergenceError": "errors",
    "DomainError": "errors",
    "GaussianSum": "profiles.gaussians",
    "Layer": "media.stack",
    "Medium": "media.medium",
    "Pose": "surface.pose",
    "RadialProfile": "profiles.radial",
    "Scene": "scene",
    "ShapeError": "errors",
    "Stack": "media.stack",
    "TexsssError": "errors",
    "bake": "baker",
    "bake_depths": "depth_maps",
    "ballistic": "profiles.ballistic",
    "depths_of": "media.depths",
    "fit_burley": "profiles.burley",
    "fit_gaussians": "profiles.fit",
    "from_colour": "media.artist",
    "hankel_profiles": "profiles.hankel",
    "human_skin": "profiles.gaussians",
    "mix": "media.medium",
    "preset": "media.presets",
    "render": "baker",
    "save_depths": "depth_maps",
    "skin": "media.artist",
    "stack_from_depths": "media.depths",
    "to_colour": "media.artist",
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
