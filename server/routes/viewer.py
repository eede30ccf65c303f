"""POST /v1/geometry, /v1/showing, /v1/map: what a viewer needs to show a scene by itself."""

from typing import Annotated

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response
from texsss_server.answers import etag
from texsss_server.bodies import SceneBody
from texsss_server.negotiate import accepted
from texsss_server.openapi import SCENE_BODY
from texsss_server.problems import invalid, responses
from texsss_server.routes.render import FORMATS, JOB, WORK
from texsss_server.routes.study import ANSWERS, numbers
from texsss_server.service import TheService

GLB = "model/gltf-binary"
BINARY = {"schema": {"type": "string", "format": "binary"}}

router = APIRouter()


class MapQuery(BaseModel):
    """Which map."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(max_length=255, examples=["albedo"])]


@router.post(
    "/v1/geometry",
    summary="The mesh of a scene",
    response_class=Response,
    responses={
        200: {
            "description": "GLB: positions, normals, atlas (TEXCOORD_0) and the author's coordinates.",
            "content": {GLB: BINARY},
        },
        202: JOB,
        304: {"description": "Unchanged since the ETag in If-None-Match."},
        **responses(*WORK),
    },
    openapi_extra=SCENE_BODY,
)
async def geometry(request: Request, scene: SceneBody, service: TheService) -> Response:
    """The mesh with its texture coordinates, without textures.

    Renders of intermediate images lie on TEXCOORD_0.
    """
    accepted(request, (GLB,))
    tag = etag(scene, GLB, what="geometry")
    return await service.answer(request, "render", tag, lambda engine, turn: engine.model(scene, turn))


@router.post(
    "/v1/showing",
    summary="Lights and camera of a scene",
    response_class=Response,
    responses=ANSWERS,
    openapi_extra=SCENE_BODY,
)
async def showing(request: Request, scene: SceneBody, service: TheService) -> Response:
    """Where lights and camera stand once placed around the mesh [mm], and the refractive index on top.

    `geometry` changes when the answer of /v1/geometry does.
    """
    return await numbers(request, scene, service, "showing")


@router.post(
    "/v1/map",
    summary="A map of a scene",
    response_class=Response,
    responses={
        200: {
            "description": "PNG, JPEG and WebP for display; EXR, NPZ and NPY (half) linear.",
            "content": dict.fromkeys(FORMATS, BINARY),
        },
        304: {"description": "Unchanged since the ETag in If-None-Match."},
        **responses(*WORK),
    },
    openapi_extra=SCENE_BODY,
)
async def a_map(
    request: Request, scene: SceneBody, query: Annotated[MapQuery, Query()], service: TheService
) -> Response:
    """One of the scene's `maps` by its name, in the format that Accept prefers."""
    media_type = accepted(request, FORMATS)
    if query.name not in scene.maps:
        raise invalid("Expected the name of one of the scene's maps.", "/maps", "unknown-map")
    tag = etag(scene, media_type, map=query.name)
    return await service.answer(
        request, None, tag, lambda engine, turn: engine.map(scene, query.name, media_type, turn)
    )
