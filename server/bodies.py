"""Bodies and what they ask for: read within limits, parsed, checked, told apart when wrong."""

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from functools import cache
from itertools import islice
from typing import Annotated, Any

from fastapi import Depends, Request
from pydantic import BaseModel, ValidationError
from starlette.requests import ClientDisconnect
from texsss_server.problems import Problem, invalid, unquoted
from texsss_server.service import Service, TheService
from texsss_server.settings import MB, Settings

from texsss.complaints import faults
from texsss.errors import DomainError
from texsss.scene import Scene, migrate
from texsss.specs import Source

JSON_TYPES = ("application/json",)
DEEPEST = 64
MOST_VALUES = 10_000  # numbers, texts, lists and objects of a body: faults are told at 100,000 a second
MOST_TOLD = 50  # complaints about one body


async def chunks(request: Request, *, limit: int, timeout_s: float, slug: str) -> AsyncIterator[bytes]:
    """The body as it arrives. Raises Problem: 413 when declared or counted too large, 408 when too slow."""
    close = {"connection": "close"}
    declared = request.headers.get("content-length", "")
    if declared.isdecimal() and int(declared) > limit:
        detail = f"Expected at most {limit:,} bytes, {int(declared):,} were announced."
        raise Problem(slug, detail, limit=limit, actual=int(declared), headers=close)
    size = 0
    deadline = asyncio.get_running_loop().time() + timeout_s
    stream = request.stream()
    try:
        while True:
            async with asyncio.timeout_at(deadline):
                chunk = await anext(stream, None)
            if chunk is None:
                return
            size += len(chunk)
            if size > limit:
                raise Problem(
                    slug,
                    f"Expected at most {limit:,} bytes, got more.",
                    limit=limit,
                    actual=size,
                    headers=close,
                )
            yield chunk
    except TimeoutError:
        detail = f"Expected the whole body within {timeout_s:g} s."
        raise Problem("request-timeout", detail, headers=close) from None
    except ClientDisconnect:
        raise Problem("client-closed-request", "The client left before its body was whole.") from None


def media_type(request: Request) -> str:
    """The Content-Type without parameters, in lower case."""
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


async def json_body(request: Request, settings: Settings) -> Any:
    """The parsed JSON of a body. Raises Problem: 415, 413, 408, 400."""
    if media_type(request) not in JSON_TYPES:
        raise Problem(
            "unsupported-media-type",
            f"Expected Content-Type: {JSON_TYPES[0]}.",
            headers={"accept-post": ", ".join(JSON_TYPES)},
        )
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        raise Problem("unsupported-media-type", "Expected a body without Content-Encoding; send it as it is.")
    limit = int(settings.body_mb * MB)
    parts = chunks(request, limit=limit, timeout_s=settings.body_timeout_s, slug="body-too-large")
    data = b"".join([part async for part in parts])
    try:
        value = json.loads(data.decode("utf-8"))
    except UnicodeDecodeError:
        raise Problem("malformed-body", "Expected UTF-8.") from None
    except json.JSONDecodeError as error:
        detail = f"Expected JSON; it breaks at line {error.lineno}, column {error.colno}."
        raise Problem("malformed-json", detail) from None
    except RecursionError:
        raise Problem("malformed-body", f"Expected JSON nested at most {DEEPEST} deep.") from None
    except ValueError:  # Python refuses integers of thousands of digits
        raise Problem("malformed-body", "Expected numbers of a sensible length.") from None
    _bound(value)
    return value


async def scene_body(request: Request, service: TheService) -> Scene:
    """The scene in a body, within the limits of this service.

    Raises Problem: as `json_body`; 422 with a pointer to every fault.
    """
    data = request.state.sent = await json_body(request, service.settings)
    try:
        scene = Scene.model_validate(migrate(data) if isinstance(data, dict) else data)
    except DomainError:
        raise invalid(
            "Expected a version of the schema that this service reads.", "/version", "version"
        ) from None
    except ValidationError as error:
        raise of_validation(error, data) from None
    except RecursionError:
        raise Problem("malformed-body", f"Expected JSON nested at most {DEEPEST} deep.") from None
    errors = list(islice(_beyond(scene, service), MOST_TOLD))
    if errors:
        raise Problem("invalid-parameters", errors[0]["detail"], errors=errors)
    return scene


SceneBody = Annotated[Scene, Depends(scene_body)]


def of_validation(error: ValidationError, data: Any, where: str = "body") -> Problem:
    """422 with a JSON pointer for every fault; texts that were sent are not repeated."""
    found, count = faults(error, data, MOST_TOLD)
    errors = [
        {"pointer": _pointer(place), "in": where, "code": kind, "detail": unquoted(told, _at(place, data))}
        for place, kind, told in found
    ]
    first = errors[0]
    field = f"{first['pointer']}: " if first["pointer"] else ""
    more = f" ({count - 1} more)" if count > 1 else ""
    return Problem("invalid-parameters", f"{field}{first['detail']}{more}", errors=errors)


def _at(place: tuple, data: Any) -> Any:
    """What was sent at a place; the nearest that exists."""
    for part in place:
        in_list = isinstance(data, list) and isinstance(part, int) and part < len(data)
        if in_list or (isinstance(data, dict) and part in data):
            data = data[part]
    return data


def _pointer(place: tuple) -> str:
    """The JSON pointer to a place."""
    return "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in place)


def _bound(value: Any) -> None:
    """Raises Problem: when JSON nests too deep, or holds more values than can be checked in passing."""
    count, waiting = 0, [(value, 0)]
    while waiting:
        node, depth = waiting.pop()
        inner = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
        count += len(inner)
        if depth > DEEPEST:
            raise Problem("malformed-body", f"Expected JSON nested at most {DEEPEST} deep.")
        if count > MOST_VALUES:
            raise Problem("malformed-body", f"Expected at most {MOST_VALUES:,} values in a body.")
        waiting += [(child, depth + 1) for child in inner]


def sources(value: Any, pointer: str = "") -> Iterator[tuple[str, Source]]:
    """Every source in a scene, with its pointer."""
    if isinstance(value, Source):
        yield pointer, value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from sources(getattr(value, name), f"{pointer}/{name}")
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from sources(item, f"{pointer}/{name.replace('~', '~0').replace('/', '~1')}")
    elif isinstance(value, tuple | list):
        for i, item in enumerate(value):
            yield from sources(item, f"{pointer}/{i}")


def _beyond(scene: Scene, service: Service) -> Iterator[dict[str, str]]:
    """What in a scene is refused here though the library would take it."""
    settings = service.settings

    def fault(pointer: str, code: str, detail: str) -> dict[str, str]:
        return {"pointer": pointer, "in": "body", "code": code, "detail": detail}

    get = cache(service.store.get)  # reads a file
    pixels: dict[str, int] = {}
    for pointer, source in sources(scene):
        if source.path is not None:
            detail = "Files of the server are not read: upload the file to /v1/assets and name it by asset."
            yield fault(f"{pointer}/path", "path-refused", detail)
        elif source.asset is not None:
            asset, kind = get(source.asset), "mesh" if pointer.startswith("/mesh") else "map"
            if asset is None:
                detail = "No such asset is here (any more); upload it to /v1/assets."
                yield fault(f"{pointer}/asset", "unknown-asset", detail)
            elif asset.kind != kind:
                detail = f"Expected a {kind} here, the asset was uploaded as a {asset.kind}."
                yield fault(f"{pointer}/asset", "wrong-kind", detail)
            else:
                pixels[asset.asset] = (asset.width or 0) * (asset.height or 0)
    if sum(pixels.values()) > settings.max_scene_pixels:
        detail = f"Expected at most {settings.max_scene_pixels:,} pixels in all maps together here."
        yield fault("/maps", "too-large", detail)
    for field in ("size", "raster"):
        if (getattr(scene.atlas, field) or 0) > settings.max_atlas:
            detail = f"Expected at most {settings.max_atlas} texels here."
            yield fault(f"/atlas/{field}", "too-large", detail)
    width, height = scene.camera.resolution
    if width * height > settings.max_picture_pixels:
        detail = f"Expected at most {settings.max_picture_pixels:,} pixels here."
        yield fault("/camera/resolution", "too-large", detail)
    elif width * height * scene.camera.samples > settings.max_rays:
        detail = f"Expected at most {settings.max_rays:,} pixels × samples here."
        yield fault("/camera/samples", "too-large", detail)
