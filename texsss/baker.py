"""Scenes baked one after the other, with the results of their stages kept in between."""

from texsss.cache import StageCache
from texsss.pipeline import Run
from texsss.result import Baked
from texsss.scene import Scene
from texsss.types import Cancel, Float, Progress, Tensor


class Baker:
    """Runs the stages of scenes in order and keeps their results, at most `cache_bytes` in all.

    Not for use from several threads at once. Raises TexsssError: whatever a stage says of its input.
    """

    def __init__(self, cache_bytes: int = 4 << 30):
        self.cache = StageCache(cache_bytes)

    def bake(self, scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None) -> Baked:
        """The baked scene. `progress` hears (stage, fraction); `cancel` is asked between steps.

        Raises Cancelled: when `cancel` says so; nothing is lost of what was already kept.
        """
        return Run(self.cache, scene, progress, cancel).baked()

    def render(
        self, scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None
    ) -> Float[Tensor, "h w 3"]:
        """The scene's picture, linear RGB. As `bake` otherwise."""
        return Run(self.cache, scene, progress, cancel).picture


def bake(scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None) -> Baked:
    """The baked scene, by a fresh `Baker`."""
    return Baker().bake(scene, progress=progress, cancel=cancel)


def render(
    scene: Scene, *, progress: Progress | None = None, cancel: Cancel | None = None
) -> Float[Tensor, "h w 3"]:
    """The scene's picture, linear RGB, by a fresh `Baker`."""
    return Baker().render(scene, progress=progress, cancel=cancel)
