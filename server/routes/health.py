"""/healthz, /readyz, /metrics: for those who run the service."""

from fastapi import APIRouter
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.responses import PlainTextResponse, Response
from texsss_server.problems import responses
from texsss_server.service import TheService

router = APIRouter(responses=responses())
NO_STORE = {"cache-control": "no-store"}


@router.head("/healthz", include_in_schema=False)
@router.get("/healthz", summary="Whether the process lives", response_class=PlainTextResponse)
async def alive() -> Response:
    """`ok` while the process can answer."""
    return PlainTextResponse("ok", headers=NO_STORE)


@router.head("/readyz", include_in_schema=False)
@router.get(
    "/readyz",
    summary="Whether work is taken",
    response_class=PlainTextResponse,
    responses=responses("starting", "stopping"),
)
async def ready(service: TheService) -> Response:
    """`ready` once a render would be served, until the service is told to stop."""
    if service.unready:
        raise service.unready
    return PlainTextResponse("ready", headers=NO_STORE)


@router.get("/metrics", summary="Prometheus metrics", response_class=PlainTextResponse)
async def metrics(service: TheService) -> Response:
    """Counters, times and sizes."""
    return Response(service.metrics.text(), headers=NO_STORE, media_type=CONTENT_TYPE_LATEST)
