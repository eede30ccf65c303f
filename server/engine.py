"""What the render thread does: scenes to bytes. The only part of the service that imports torch."""

import torch
from texsss_server.answers import Answer
from texsss_server.assets import Store
from texsss_server.drafts import drafted
from texsss_server.encode import BAKES, LINEAR, PICTURES, archive, encoded, glb
from texsss_server.settings import MB, Settings
from texsss_server.turn import Turn

from texsss.baker import Baker, lasting_shelf
from texsss.curve import presets
from texsss.reading import reading
from texsss.scene import Scene
from texsss.shots import OutputSpec

LIGHT = ("picture", "irradiance", "diffused", "exitance", "radiance", "single", "albedo", "gaussian")
"""Images that are exposed and tone mapped to be seen; all others are data, shown from black to white."""


class Engine:
    """One `Baker` that all requests share. Lives in the render thread."""

    def __init__(self, settings: Settings, store: Store):
        torch.set_num_threads(settings.threads)
        self.settings = settings
        shelf = lasting_shelf(settings.disk_mb)
        self.baker = Baker(int(settings.cache_mb * MB), assets=store.path, shelf=shelf)

    @property
    def cache_bytes(self) -> int:
        """Bytes of the stages' results kept now."""
        return self.baker.cache.bytes_used

    def render(self, scene: Scene, image: str, media_type: str, turn: Turn) -> Answer:
        """The picture or an intermediate image of a scene."""
        hooks = {"progress": turn.progress, "cancel": turn.stopped}
        if image == "picture":
            values = self.baker.render(scene, **hooks)
        else:
            values = self.baker.intermediate(scene, image, **hooks)
        text = None
        if media_type not in LINEAR and image.startswith(LIGHT):
            values = self.baker.display(scene, values)
        elif media_type not in LINEAR:
            found = reading(image, values)
            values, text = found.shown(values), found.text
        body = encoded(values, media_type, text)
        return Answer(body, media_type, f"{image}.{PICTURES[media_type]}", turn.seconds)

    def model(self, scene: Scene, turn: Turn) -> Answer:
        """The mesh and its atlas as a GLB without textures."""
        body = self.baker.model(scene, progress=turn.progress, cancel=turn.stopped)
        return Answer(body, "model/gltf-binary", "geometry.glb", turn.seconds)

    def map(self, scene: Scene, name: str, media_type: str, turn: Turn) -> Answer:
        """A map of a scene; linear light for a display, numbers as they are."""
        values = self.baker.map(scene, name, cancel=turn.stopped)
        if media_type not in LINEAR and scene.maps[name].space == "srgb":
            plain = scene.model_copy(update={"output": OutputSpec(tonemap="linear")})
            values = self.baker.display(plain, values.expand(-1, -1, 3))
        return Answer(encoded(values, media_type), media_type, f"map.{PICTURES[media_type]}", turn.seconds)

    def showing(self, scene: Scene, turn: Turn) -> dict:
        """Where lights and camera stand, for viewers."""
        return self.baker.showing(scene, progress=turn.progress, cancel=turn.stopped)

    def bake(self, scene: Scene, media_type: str, turn: Turn) -> Answer:
        """The baked model, or all files of the bake."""
        baked = self.baker.bake(scene, progress=turn.progress, cancel=turn.stopped)
        body = glb(baked) if media_type == "model/gltf-binary" else archive(baked, turn.progress)
        return Answer(body, media_type, f"model.{BAKES[media_type]}", turn.seconds)

    def profile(self, scene: Scene, turn: Turn) -> dict:
        """The material's scattering profile as numbers."""
        return self.baker.curve(scene, cancel=turn.stopped)

    def inspect(self, scene: Scene, turn: Turn) -> dict:
        """Mesh, texture coordinates and scale, examined."""
        return self.baker.inspect(scene, progress=turn.progress, cancel=turn.stopped)

    def presets(self) -> list[dict]:
        """The media that scenes may name."""
        return presets()

    def prepare(self, scene: Scene, turn: Turn) -> None:
        """Loads what work needs, and fills the cache for pictures and drafts of the scene; drafts first."""
        hooks = {"progress": turn.progress, "cancel": turn.stopped}
        draft = drafted(scene, self.settings)
        self.baker.intermediate(draft, "diffused", **hooks)  # what the page asks for
        for wanted in (draft, scene):
            encoded(self.baker.display(wanted, self.baker.render(wanted, **hooks)), "image/jpeg")
