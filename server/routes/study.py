"""POST /v1/profile and /v1/inspect: a scene in, numbers out."""

import json
from typing import Literal

from fastapi import APIRouter, Request
from starlette.responses import Response
from texsss_server.answers import Answer, etag
from texsss_server.bodies import SceneBody
from texsss_server.negotiate import accepted
from texsss_server.openapi import SCENE_BODY
from texsss_server.problems import responses
from texsss_server.routes.render import WORK
from texsss_server.service import Service, TheService

from texsss.scene import Scene

JSON = "application/json"
ANSWERS = {
    200: {"description": "Numbers, units in their names.", "content": {JSON: {"schema": {"type": "object"}}}},
    304: {"description": "Unchanged since the ETag in If-None-Match."},
    **responses(*WORK),
}

router = APIRouter()


@router.post(
    "/v1/profile",
    summary="Profile of a material",
    response_class=Response,
    responses=ANSWERS,
    openapi_extra=SCENE_BODY,
)
async def profile(request: Request, scene: SceneBody, service: TheService) -> Response:
    """R(r) of the scene's material per channel, its Gaussians, radii and mean free path."""
    return await numbers(request, scene, service, "profile")


@router.post(
    "/v1/inspect",
    summary="Examine a scene",
    response_class=Response,
    responses=ANSWERS,
    openapi_extra=SCENE_BODY,
)
async def inspect(request: Request, scene: SceneBody, service: TheService) -> Response:
    """Mesh, texture coordinates and scale, with advice."""
    return await numbers(request, scene, service, "inspect")


async def numbers(
    request: Request, scene: Scene, service: Service, what: Literal["profile", "inspect", "showing"]
) -> Response:
    """The answer of that method of the engine as JSON."""
    accepted(request, [JSON])

    def call(engine, turn) -> Answer:
        found = getattr(engine, what)(scene, turn)
        return Answer(json.dumps(found, allow_nan=False).encode(), JSON, None, turn.seconds)

    return await service.answer(request, None, etag(scene, JSON, what=what), call)
