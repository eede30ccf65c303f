"""What can go wrong over HTTP: one table from slug to status, one from error class to slug (RFC 9457)."""

import json
import re
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple

from starlette.responses import Response

from texsss.complaints import field_names
from texsss.errors import (
    AssetError,
    Cancelled,
    ConvergenceError,
    DomainError,
    LimitError,
    ShapeError,
    TexsssError,
)


class Kind(NamedTuple):
    status: int
    title: str


KINDS = {
    "malformed-json": Kind(400, "The body is not JSON"),
    "malformed-body": Kind(400, "The body cannot be read"),
    "malformed-request": Kind(400, "The request cannot be read"),
    "bad-host": Kind(400, "This host is not served here"),
    "unauthorized": Kind(401, "An API key is needed"),
    "origin-refused": Kind(403, "Pages of this origin may not ask this"),
    "not-found": Kind(404, "Nothing is here"),
    "method-not-allowed": Kind(405, "This method is not served here"),
    "not-acceptable": Kind(406, "No format on offer is accepted"),
    "request-timeout": Kind(408, "The request took too long to arrive"),
    "not-ready": Kind(409, "The job is not finished"),
    "job-failed": Kind(409, "The job did not give a result"),
    "superseded": Kind(409, "A newer draft took the place of this one"),
    "body-too-large": Kind(413, "The body is too large"),
    "asset-too-large": Kind(413, "The file is too large"),
    "unsupported-media-type": Kind(415, "This Content-Type is not read here"),
    "unsupported-mesh": Kind(415, "This kind of file is not read here"),
    "unsupported-map": Kind(415, "This kind of image is not read here"),
    "invalid-parameters": Kind(422, "Something in the request is out of range"),
    "invalid-mesh": Kind(422, "The mesh cannot be used"),
    "invalid-map": Kind(422, "The image cannot be used"),
    "parse-limit": Kind(422, "Reading the file takes too much time or memory"),
    "no-convergence": Kind(422, "The computation did not converge"),
    "queue-full": Kind(429, "Too much is waiting already"),
    "client-closed-request": Kind(499, "The client left"),
    "internal": Kind(500, "Something broke here"),
    "render-timeout": Kind(503, "The computation took too long"),
    "starting": Kind(503, "The service is starting"),
    "stopping": Kind(503, "The service is stopping"),
    "too-many-connections": Kind(503, "Too many connections are open"),
    "storage-full": Kind(507, "There is no room for the file"),
}
"""Every answer that is not a success, by the last part of its type."""

SLUGS: dict[type[TexsssError], str] = {
    LimitError: "parse-limit",
    AssetError: "invalid-parameters",
    ShapeError: "invalid-parameters",
    DomainError: "invalid-parameters",
    ConvergenceError: "no-convergence",
    Cancelled: "render-timeout",
}
"""The first class that fits counts."""

MOST_STRINGS = 10_000
FOLDERS = re.compile(r"(?<![\w.])/(?:[^\s'\",;:()/][^\n'\",;:()/]*/)+(?=[^\s'\",;:()/])")
"""Absolute folders before the name of a file; theirs may have spaces."""


class Problem(Exception):
    """An answer of the table, raised anywhere in a request. `extensions` go into the body."""

    def __init__(
        self, slug: str, detail: str, *, headers: Mapping[str, str] | None = None, **extensions: Any
    ):
        super().__init__(detail)
        self.slug, self.detail, self.extensions = slug, detail, extensions
        self.headers = dict(headers or {})

    @property
    def status(self) -> int:
        """The HTTP status."""
        return KINDS[self.slug].status

    def as_dict(self, request_id: str) -> dict[str, Any]:
        """The members of its JSON body."""
        return {
            "type": f"/problems/{self.slug}",
            "title": KINDS[self.slug].title,
            "status": self.status,
            "detail": self.detail,
            "instance": f"urn:request:{request_id}",
            **self.extensions,
        }

    def response(self, request_id: str) -> Response:
        """The answer itself, never to be stored."""
        # ASCII escapes carry whatever a client sent, lone surrogates too
        body = json.dumps(self.as_dict(request_id), allow_nan=False).encode()
        headers = {"cache-control": "no-store", **self.headers}
        return Response(body, self.status, headers, media_type="application/problem+json")


def retry_after(slug: str, detail: str, seconds: int = 1) -> Problem:
    """A problem that goes away by itself."""
    return Problem(slug, detail, headers={"retry-after": str(seconds)})


def no_room(error: Exception) -> Problem:
    """507 for a disk that takes no more."""
    why = getattr(error, "strerror", None) or "no room"
    return Problem("storage-full", f"A file could not be kept ({why}); try later.")


def invalid(detail: str, pointer: str, code: str, where: str = "body") -> Problem:
    """422 for one place of the request; `pointer` is a JSON pointer into the body, or a parameter's name."""
    error = {"pointer": pointer, "in": where, "code": code, "detail": detail}
    return Problem("invalid-parameters", detail, errors=[error])


def of_error(error: TexsssError, sent: Any = None) -> Problem:
    """The answer to an error of the library, without our folders' names and without what was `sent`."""
    slug = next((slug for kind, slug in SLUGS.items() if isinstance(error, kind)), "internal")
    detail = FOLDERS.sub("", unquoted(str(error), sent))
    if slug == "invalid-parameters":
        return invalid(detail, "", type(error).__name__)
    if slug == "render-timeout":
        return retry_after(slug, detail)
    return Problem(slug, detail)


def unquoted(message: str, sent: Any) -> str:
    """A message without the strings that were sent, a few of them at the least."""
    texts = set(islice(_strings(sent), MOST_STRINGS))
    for text in sorted(texts, key=len, reverse=True):
        message = message.replace(repr(text), "what was sent")
    return message


def _strings(data: Any) -> Iterator[str]:
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict):
        for key, value in data.items():
            if key not in field_names():
                yield key
            yield from _strings(value)
    elif isinstance(data, list):
        for value in data:
            yield from _strings(value)


def responses(*slugs: str) -> dict[int | str, dict[str, Any]]:
    """The answers that a route may give besides success, for OpenAPI; those of every route included."""
    always = ("bad-host", "unauthorized", "internal")
    found: dict[int, list[str]] = {}
    for slug in (*slugs, *always):
        found.setdefault(KINDS[slug].status, []).append(slug)
    schema = {"$ref": "#/components/schemas/Problem"}
    return {
        status: {
            "description": " · ".join(f"{KINDS[slug].title} (`{slug}`)" for slug in names),
            "content": {"application/problem+json": {"schema": schema}},
        }
        for status, names in sorted(found.items())
    }


SCHEMA = {
    "type": "object",
    "description": "RFC 9457. `errors`, `limit`, `actual`, `available`, `reason` come with some types.",
    "required": ["type", "title", "status", "detail", "instance"],
    "properties": {
        "type": {"type": "string", "enum": [f"/problems/{slug}" for slug in KINDS]},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
        "errors": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["pointer", "in", "code", "detail"],
                "properties": {
                    "pointer": {"type": "string"},
                    "in": {"type": "string"},
                    "code": {"type": "string"},
                    "detail": {"type": "string"},
                },
            },
        },
    },
}
"""Of a problem's body, for OpenAPI."""
