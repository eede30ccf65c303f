"""Scenes made cheap: what is shown while a slider moves."""

from texsss_server.settings import Settings

from texsss.scene import Scene


def drafted(scene: Scene, settings: Settings) -> Scene:
    """The scene at the size of a draft."""
    raster = min(scene.atlas.texels, settings.draft_atlas)
    atlas = scene.atlas.model_copy(update={"raster": raster})  # on the same coordinates as the final
    width, height = scene.camera.resolution
    scale = min(1.0, (settings.draft_pixels / (width * height)) ** 0.5)
    resolution = max(1, round(width * scale)), max(1, round(height * scale))
    camera = scene.camera.model_copy(update={"resolution": resolution, "samples": 1})
    methods = scene.methods
    if methods.single_scattering == "auto":
        methods = methods.model_copy(update={"single_scattering": "none"})  # which needs no rays of its own
    return scene.model_copy(update={"atlas": atlas, "camera": camera, "methods": methods})
