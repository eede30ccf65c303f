"""POST /v1/bake: a scene in, a model or a bundle of maps out."""

from fastapi import APIRouter, Request
from starlette.responses import Response
from texsss_server.answers import etag
from texsss_server.bodies import SceneBody
from texsss_server.negotiate import accepted
from texsss_server.openapi import SCENE_BODY
from texsss_server.problems import responses
from texsss_server.routes.render import JOB, WORK
from texsss_server.service import TheService

FORMATS = ("model/gltf-binary", "application/zip")

router = APIRouter()


@router.post(
    "/v1/bake",
    summary="Bake a scene",
    response_class=Response,
    responses={
        200: {
            "description": "GLB: the mesh with its baked texture, unlit. ZIP: EXR, PNG, GLB and report.json.",
            "content": {name: {"schema": {"type": "string", "format": "binary"}} for name in FORMATS},
        },
        202: JOB,
        304: {"description": "Unchanged since the ETag in If-None-Match."},
        **responses(*WORK),
    },
    openapi_extra=SCENE_BODY,
)
async def bake(request: Request, scene: SceneBody, service: TheService) -> Response:
    """The baked scene as a GLB, or a ZIP of all its files, as Accept prefers.

    Long work: `Prefer: respond-async` makes it a job; with `wait=S` besides, only if it takes longer than S
    seconds.
    """
    media_type = accepted(request, FORMATS)
    return await service.answer(
        request, "bake", etag(scene, media_type), lambda engine, turn: engine.bake(scene, media_type, turn)
    )
