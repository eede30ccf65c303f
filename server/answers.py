"""Encoded answers: named by everything they depend on, kept for those who ask again."""

import hashlib
import json
from collections import OrderedDict
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from texsss.scene import Scene

VERSION = version("texsss")  # looked up in files, which takes longer than a whole answer that is kept


@dataclass(frozen=True)
class Answer:
    """The bytes of a success, how they are encoded, and what its stages took [s]."""

    body: bytes
    media_type: str
    filename: str | None
    seconds: dict[str, float]


def etag(scene: Scene, media_type: str, **options: Any) -> str:
    """A strong ETag: equal scenes, options and formats give equal bytes in one version of texsss."""
    named = json.dumps([VERSION, media_type, options, scene.model_dump(mode="json")], sort_keys=True)
    return f'"{hashlib.sha256(named.encode()).hexdigest()[:32]}"'


def matches(conditions: list[str], tag: str) -> bool:
    """Whether If-None-Match names `tag`. "*" doesn't: whether an answer exists is known only by making it."""
    return tag in {one.strip().removeprefix("W/") for one in ",".join(conditions).split(",")}


class Answers:
    """The answers given last, at most `max_bytes` in all."""

    def __init__(self, max_bytes: int):
        self.max_bytes = max_bytes
        self._kept: OrderedDict[str, Answer] = OrderedDict()
        self.bytes_used = 0

    def get(self, tag: str) -> Answer | None:
        """The answer named `tag`, if it is still kept."""
        answer = self._kept.get(tag)
        if answer is not None:
            self._kept.move_to_end(tag)
        return answer

    def put(self, tag: str, answer: Answer) -> None:
        """Keeps an answer; the oldest ones go. Call it on the loop alone."""
        if tag in self._kept or len(answer.body) > self.max_bytes:
            return
        self._kept[tag] = answer
        self.bytes_used += len(answer.body)
        while self.bytes_used > self.max_bytes:
            _, oldest = self._kept.popitem(last=False)
            self.bytes_used -= len(oldest.body)
