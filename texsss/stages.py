"""How stages run: kept by content, timed, heard of, stopped on request."""

import time
from collections.abc import Callable, Iterator
from typing import Any

from texsss.cache import Kept, StageCache, content_key
from texsss.scene import Scene
from texsss.types import Cancel, Progress, check_cancelled

STAGE_VERSIONS = {
    "mesh": 1,
    "pose": 1,
    "inward": 1,
    "occluder": 1,
    "atlas": 1,
    "texels": 1,
    "maps": 1,
    "seams": 1,
    "albedo": 1,
    "sites": 1,
    "curvature": 1,
    "light": 5,
    "operators": 10,
    "doubts": 2,
    "bank": 1,
    "thickness": 2,
    "samples": 1,
    "octree": 4,
    "weights": 15,
    "angular": 14,
    "exchange": 1,
    "echo": 1,
    "exitance": 1,
    "beneath": 2,
    "planes": 3,
    "camera": 1,
    "sights": 6,
    "picture": 15,
}
"""Raised whenever a stage's result changes for the same inputs, so that nothing stale is reused."""

LASTING = {"operators"}
"""Stages whose results are dear enough to be kept on disk."""


def _kept(part: Any) -> Iterator[Kept]:
    """Every result among what a stage depends on."""
    if isinstance(part, Kept):
        yield part
    elif isinstance(part, dict):
        yield from _kept(list(part.values()))
    elif isinstance(part, tuple | list):
        for item in part:
            yield from _kept(item)


class Stages:
    """The stages of one scene; each is made once, or taken from `cache`."""

    def __init__(self, cache: StageCache, scene: Scene, progress: Progress | None, cancel: Cancel | None):
        self.cache, self.scene, self.cancel = cache, scene, cancel
        self.tell: Progress = progress or (lambda stage, fraction: None)
        self.seconds: dict[str, float] = {}
        self.made: dict[str, Kept] = {}

    def stage(self, name: str, make: Callable[[], Any], *depends: Any) -> Kept:
        """The result of `make`, kept under the content of `depends`; of a pose if one of these is."""
        check_cancelled(self.cancel)
        key = content_key(name, STAGE_VERSIONS[name], *depends)
        if key in self.made:
            return self.made[key]
        self.tell(name, 0.0)
        start = time.perf_counter()
        passing = any(part.passing for part in _kept(depends))
        lasts = name in LASTING and not passing
        value, fresh = self.cache.get_or_make(key, make, lasts=lasts, passing=passing)
        if fresh:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
        self.tell(name, 1.0)
        return self.made.setdefault(key, Kept(value, key, passing))

    def hooks(self, name: str) -> dict[str, Any]:
        """What a long stage listens to and speaks through; the pipeline names the stages, not the rooms."""
        return {"progress": lambda _, fraction: self.tell(name, fraction), "cancel": self.cancel}
