"""/v1/jobs: how long work is followed, fetched and cancelled."""

from collections.abc import AsyncIterable
from typing import Annotated

from fastapi import APIRouter, Depends
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.responses import Response
from texsss_server.jobs import Job, JobView
from texsss_server.problems import Problem, responses
from texsss_server.service import TheService, success

router = APIRouter(responses=responses("not-found"))


async def the_job(job: str, service: TheService) -> Job:
    """The job of a path. Raises Problem: 404."""
    found = service.jobs.get(job)
    if found is None:
        raise Problem("not-found", "No such job is here (any more).")
    return found


TheJob = Annotated[Job, Depends(the_job)]


@router.get("/v1/jobs/{job}", summary="How far a job is")
async def state(job: TheJob, response: Response) -> JobView:
    """Where it stands."""
    response.headers["cache-control"] = "no-store"
    return job.view()


@router.get("/v1/jobs/{job}/events", summary="Follow a job", response_class=EventSourceResponse)
async def events(job: TheJob) -> AsyncIterable[ServerSentEvent]:
    """Server-sent events `progress`, then one of `done`, `failed`, `cancelled`; data as of the job itself.

    The stream ends early with `stopping` when the service stops.
    """
    async for view in job.follow():
        stopping = "stopping" if job.turn.reason == "stopping" else "progress"
        name = stopping if view.state in ("queued", "running") else view.state
        yield ServerSentEvent(event=name, data=view.model_dump(mode="json"))


@router.get(
    "/v1/jobs/{job}/result",
    summary="What a job made",
    response_class=Response,
    responses={
        200: {
            "description": "In the format that was accepted when the job was made.",
            "content": {"*/*": {"schema": {"type": "string", "format": "binary"}}},
        },
        **responses("not-found", "not-ready", "job-failed"),
    },
)
async def result(job: TheJob) -> Response:
    """The image, model or bundle."""
    if job.answer is not None:
        job.fetched = True
        return success(job.answer, {"cache-control": "no-store", "etag": job.tag})
    if job.problem is not None:
        cause = job.problem.as_dict(job.id)
        raise Problem("job-failed", f"The job ended without a result: {job.problem.detail}", cause=cause)
    raise Problem("not-ready", "The job is not finished; follow its events.", headers={"retry-after": "1"})


@router.delete("/v1/jobs/{job}", summary="Cancel or forget a job", status_code=204)
async def cancel(job: TheJob, service: TheService) -> Response:
    """Cancels a job that waits or runs; forgets a finished one."""
    service.jobs.remove(job)
    return Response(status_code=204)
