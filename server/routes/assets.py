"""/v1/assets: meshes and maps of one's own."""

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse, JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response
from starlette.types import Receive, Scope, Send
from texsss_server.answers import matches
from texsss_server.bodies import chunks, media_type
from texsss_server.examine import Asset
from texsss_server.problems import Problem, invalid, responses
from texsss_server.service import Service, TheService
from texsss_server.settings import MB

from texsss.errors import AssetError

TYPES = ("application/octet-stream", "model/", "image/")
ACCEPT_POST = "application/octet-stream, model/*, image/*"
UPLOAD = (
    *("malformed-body", "request-timeout", "asset-too-large", "unsupported-media-type", "unsupported-mesh"),
    *("unsupported-map", "invalid-parameters", "invalid-mesh", "invalid-map", "parse-limit", "queue-full"),
    *("stopping", "storage-full"),
)
BINARY = {"schema": {"type": "string", "format": "binary"}}
BODY = {
    "requestBody": {
        "required": True,
        "description": "The file's bytes.",
        "content": dict.fromkeys(("application/octet-stream", "model/obj", "image/png"), BINARY),
    }
}

router = APIRouter()


class Whole(FileResponse):
    """A file, never a part of it: ranges may be ignored (RFC 9110, section 14.2)."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = [(name, value) for name, value in scope["headers"] if name != b"range"]
        await super().__call__({**scope, "headers": headers}, receive, send)


class UploadQuery(BaseModel):
    """What the file is called; its ending says what it is."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(min_length=3, max_length=255, examples=["head.obj"])]


@router.post(
    "/v1/assets",
    summary="Upload a mesh or map",
    status_code=201,
    response_model=Asset,
    responses={200: {"description": "It was here already.", "model": Asset}, **responses(*UPLOAD)},
    openapi_extra=BODY,
)
async def upload(request: Request, query: Annotated[UploadQuery, Query()], service: TheService) -> Response:
    """Reads the file in a limited process and keeps it under its sha256.

    OBJ, PLY, STL, GLB; PNG, JPEG, WebP, EXR, HDR. Name it in a scene: `{"source": {"asset": sha256}}`.
    """
    if not media_type(request).startswith(TYPES):
        detail = f"Expected Content-Type: one of {ACCEPT_POST}."
        raise Problem("unsupported-media-type", detail, headers={"accept-post": ACCEPT_POST})
    if len(request.query_params.getlist("name")) > 1:
        raise invalid("name: expected one, got several.", "name", "repeated", "query")
    if service.stopping and service.unready:
        raise service.unready
    settings = service.settings
    limit = int(settings.upload_mb * MB)
    parts = chunks(request, limit=limit, timeout_s=settings.upload_timeout_s, slug="asset-too-large")
    asset, new = await service.store.add(query.name, parts)
    headers = {"location": f"/v1/assets/{asset.asset}", "cache-control": "no-store"}
    return JSONResponse(asset.model_dump(mode="json"), 201 if new else 200, headers)


@router.get("/v1/assets/{asset}", summary="Describe an upload", responses=responses("not-found"))
async def describe(asset: str, service: TheService) -> Asset:
    """What an upload is."""
    return _found(asset, service)


@router.get(
    "/v1/assets/{asset}/content",
    summary="The bytes of an upload",
    response_class=FileResponse,
    responses={
        200: {"description": "As uploaded.", "content": {"application/octet-stream": BINARY}},
        304: {"description": "Unchanged since the ETag in If-None-Match."},
        **responses("not-found"),
    },
)
async def content(request: Request, asset: str, service: TheService) -> Response:
    """The file as it was uploaded."""
    found, tag = _found(asset, service), f'"{asset}"'
    headers = {"etag": tag, "cache-control": "private, max-age=3600", "accept-ranges": "none"}
    if matches(request.headers.getlist("if-none-match"), tag):
        return Response(status_code=304, headers=headers)
    try:
        path = service.store.path(asset)
        return Whole(
            path, 200, headers, "application/octet-stream", filename=found.name, stat_result=path.stat()
        )
    except (AssetError, FileNotFoundError):  # removed just now
        raise _gone() from None


@router.delete(
    "/v1/assets/{asset}", summary="Remove an upload", status_code=204, responses=responses("not-found")
)
async def remove(asset: str, service: TheService) -> Response:
    """Forgets an upload."""
    _found(asset, service)
    service.store.remove(asset)
    return Response(status_code=204)


def _found(asset: str, service: Service) -> Asset:
    found = service.store.get(asset)
    if found is None:
        raise _gone()
    return found


def _gone() -> Problem:
    return Problem("not-found", "No such asset is here (any more).")
