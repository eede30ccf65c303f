"""POST /v1/render: a scene in, an image out."""

from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response
from texsss_server.answers import etag
from texsss_server.bodies import SceneBody
from texsss_server.drafts import drafted
from texsss_server.jobs import JobView
from texsss_server.negotiate import accepted
from texsss_server.openapi import SCENE_BODY
from texsss_server.problems import responses
from texsss_server.service import TheService

from texsss.specs import INTERMEDIATES

FORMATS = (
    *("image/png", "image/jpeg", "image/webp"),
    *("image/x-exr", "application/x-npz", "application/x-npy"),
)
IMAGE = f"^(picture|{INTERMEDIATES})$"
WORK = (
    *("malformed-json", "malformed-body", "not-acceptable", "request-timeout", "superseded"),
    *("body-too-large", "unsupported-media-type", "invalid-parameters", "no-convergence", "queue-full"),
    *("render-timeout", "starting", "stopping", "storage-full"),
)
"""Problems of routes that compute."""

JOB = {
    "description": "A job was made; follow Location.",
    "model": JobView,
    "headers": {"Location": {"schema": {"type": "string"}}},
}
ClientId = Annotated[str | None, Header(alias="x-client-id", pattern=r"^[\w.-]{1,64}$")]

router = APIRouter()


class RenderQuery(BaseModel):
    """What to see of a scene, and how well."""

    model_config = ConfigDict(extra="forbid")

    image: Annotated[str, Field(pattern=IMAGE)] = "picture"
    quality: Literal["draft", "final"] = "final"


@router.post(
    "/v1/render",
    summary="Render a scene",
    response_class=Response,
    responses={
        200: {
            "description": "PNG, JPEG and WebP for display; EXR, NPZ and NPY (half) linear.",
            "content": {name: {"schema": {"type": "string", "format": "binary"}} for name in FORMATS},
        },
        202: JOB,
        304: {"description": "Unchanged since the ETag in If-None-Match."},
        **responses(*WORK),
    },
    openapi_extra=SCENE_BODY,
)
async def render(
    request: Request,
    scene: SceneBody,
    query: Annotated[RenderQuery, Query()],
    service: TheService,
    client: ClientId = None,
) -> Response:
    """The scene's picture, or an intermediate image over its atlas, in the format that Accept prefers.

    `quality=draft` lowers atlas, resolution and samples for speed; with `X-Client-Id`, a draft takes the
    place of that client's older ones. With `Prefer: respond-async` it becomes a job; with `wait=S` besides,
    only if it takes longer than S seconds.
    """
    media_type = accepted(request, FORMATS)
    draft = query.quality == "draft"
    wanted = drafted(scene, service.settings) if draft else scene
    tag = etag(wanted, media_type, image=query.image)
    return await service.answer(
        request,
        "render",
        tag,
        lambda engine, turn: engine.render(wanted, query.image, media_type, turn),
        drafts_of=client if draft else None,
    )
