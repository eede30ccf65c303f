"""Results kept by the content they depend on, bounded by bytes."""

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from threading import Lock
from typing import Any

import torch
from pydantic import BaseModel

from texsss.shelf import Shelf


@dataclass(frozen=True)
class Kept:
    """A result and the key of everything it was made from; `passing`: it is of a pose, and others follow."""

    value: Any
    key: str
    passing: bool = False

    def turned(self, value: Any, how: str) -> "Kept":
        """What was made of this alone, in a way that `how` names."""
        return replace(self, value=value, key=f"{self.key} {how}")


def content_key(*parts: Any) -> str:
    """A name for `parts` by content: equal parts, equal name.

    Parts are strings, numbers, None, bytes, pydantic models, `Kept` results (by their key), tensors,
    and tuples, lists and dictionaries of these. Raises TypeError: on anything else, since its repr
    might hide what it depends on.
    """
    digest = hashlib.blake2b(digest_size=16)
    _feed(digest, parts)
    return digest.hexdigest()


def _feed(digest: Any, part: Any) -> None:
    if isinstance(part, Kept):
        text = f"kept {part.key}"
    elif isinstance(part, BaseModel):
        text = f"{type(part).__name__} {part.model_dump_json()}"
    elif isinstance(part, torch.Tensor):
        text = f"tensor {part.dtype} {tuple(part.shape)}"
        digest.update(part.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    elif isinstance(part, bytes):
        text = f"bytes {hashlib.blake2b(part).hexdigest()}"
    elif isinstance(part, dict):
        text = f"dict {len(part)}"
        for key in sorted(part):
            _feed(digest, (key, part[key]))
    elif isinstance(part, tuple | list):
        text = f"list {len(part)}"
        for item in part:
            _feed(digest, item)
    elif part is None or isinstance(part, str | int | float | torch.dtype):
        text = f"{type(part).__name__} {part!r}"
    else:
        raise TypeError(f"content_key: cannot name a {type(part).__name__} by its content")
    digest.update(f"\x1f{text}".encode())


class StageCache:
    """A least-recently-used store of results, at most `max_bytes` in all, an eighth of it passing ones.

    `bytes_used`, `bytes_passing`: of what is kept now. Tensors of results count, and what they say they hold
    beside them, by an attribute `held_bytes`. Results that hold a tensor which requires grad are never kept:
    they belong to one graph. Those that are to last are kept on the `shelf`, too, if there is one.
    """

    def __init__(self, max_bytes: int, shelf: Shelf | None = None):
        self.max_bytes, self.shelf = max_bytes, shelf
        self._kept: OrderedDict[str, tuple[Any, int, bool]] = OrderedDict()
        self._lock = Lock()
        self.bytes_used = self.bytes_passing = 0

    def get_or_make(
        self, key: str, make: Callable[[], Any], *, lasts: bool = False, passing: bool = False
    ) -> tuple[Any, bool]:
        """The result under `key`, made if it isn't there, and whether it had to be made.

        `lasts`: whether it is worth a place on the shelf. `passing`: whether many like it will follow, which
        are not to drive out the rest.
        """
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key][0], False
        shelf = self.shelf if lasts else None
        found = None if shelf is None else shelf.get(key)
        value = make() if found is None else found
        tensors = list(_tensors(value))
        if not any(tensor.requires_grad for tensor in tensors):
            storages = {t.untyped_storage().data_ptr(): t.untyped_storage().nbytes() for t in tensors}
            size = sum(storages.values()) + getattr(value, "held_bytes", 0)
            self._keep(key, value, size, passing)
            if shelf is not None and found is None:
                shelf.put(key, value, size)
        return value, True

    def _keep(self, key: str, value: Any, size: int, passing: bool) -> None:
        most_passing = self.max_bytes // 8
        if size > (most_passing if passing else self.max_bytes):
            return
        with self._lock:
            self._drop(key)
            self._kept[key] = (value, size, passing)
            self.bytes_used += size
            self.bytes_passing += size if passing else 0
            while self.bytes_passing > most_passing:
                self._drop(next(name for name, (_, _, goes) in self._kept.items() if goes))
            while self.bytes_used > self.max_bytes:
                self._drop(next(iter(self._kept)))

    def _drop(self, key: str) -> None:
        _, size, passing = self._kept.pop(key, (None, 0, False))
        self.bytes_used -= size
        self.bytes_passing -= size if passing else 0

    def clear(self) -> None:
        """Forgets everything."""
        with self._lock:
            self._kept.clear()
            self.bytes_used = self.bytes_passing = 0


def _tensors(value: Any):
    """Every tensor reachable through dataclasses, tuples, lists and dictionaries."""
    if isinstance(value, torch.Tensor):
        yield value
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from _tensors(getattr(value, field.name))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _tensors(item)
    elif isinstance(value, dict):
        for item in value.values():
            yield from _tensors(item)
