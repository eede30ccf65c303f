"""What the render thread does: scenes to bytes. The only part of the service that imports torch."""

import torch
from texsss_server.answers import Answer
from texsss_server.assets import Store
from texsss_server.encode import BAKES, LINEAR, PICTURES, archive, encoded, glb, ranged
from texsss_server.settings import MB, Settings
from texsss_server.worker import Turn

from texsss.baker import Baker
from texsss.curve import presets
from texsss.scene import Scene

TINY = {"atlas": {"size": 64}, "camera": {"resolution": [32, 24], "samples": 1}}
DATA = ("coverage", "position", "normal", "texel-mm", "weight")


class Engine:
    """One `Baker` that all requests share. Lives in the render thread."""

    def __init__(self, settings: Settings, store: Store):
        torch.set_num_threads(settings.threads)
        self.settings = settings
        self.baker = Baker(int(settings.cache_mb * MB), assets=store.path)
        self._warm_up()

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
        if media_type not in LINEAR:
            is_data = image.startswith(DATA)
            values = ranged(values) if is_data else self.baker.display(scene, values)
        body = encoded(values, media_type)
        return Answer(body, media_type, f"{image}.{PICTURES[media_type]}", turn.seconds)

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
        """Fills the cache with what the scene needs."""
        self.baker.render(scene, progress=turn.progress, cancel=turn.stopped)

    def _warm_up(self) -> None:
        """One small picture, so that the first request finds libraries loaded."""
        if self.settings.warm:
            scene = Scene.parse(TINY)
            encoded(self.baker.display(scene, self.baker.render(scene)), "image/jpeg")
