"""Long work: accepted, followed, fetched, cancelled."""

import json
import time
from pathlib import Path

import httpx
import pytest
from serving import problem

from texsss.stages import STAGE_VERSIONS

ASYNC = {"prefer": "respond-async"}


def accepted(client: httpx.Client, scene: dict, path: str = "/v1/bake") -> dict:
    answer = client.post(path, json=scene, headers=ASYNC)
    assert answer.status_code == 202, answer.text
    job = answer.json()
    assert answer.headers["location"] == job["links"]["self"] == f"/v1/jobs/{job['id']}"
    assert answer.headers["cache-control"] == "no-store"
    return job


def events(client: httpx.Client, job: dict) -> list[tuple[str, dict]]:
    found, name = [], ""
    with client.stream("GET", job["links"]["events"]) as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        for line in stream.iter_lines():
            if line.startswith("event: "):
                name = line.removeprefix("event: ")
            elif line.startswith("data: "):
                found.append((name, json.loads(line.removeprefix("data: "))))
    return found


def slow(small: dict, seed: int) -> dict:
    """Seconds of work with many steps."""
    return small | {
        "seed": seed,
        "atlas": {"size": 256},
        "camera": {"resolution": [1600, 1200], "samples": 16},
    }


@pytest.mark.parametrize("path, kind", [("/v1/bake", "model/gltf-binary"), ("/v1/render", "image/png")])
def test_job_from_start_to_result(client, small, path, kind):
    job = accepted(client, small | {"seed": 11}, path)
    heard = events(client, job)
    assert heard[-1][0] == "done" and heard[-1][1]["fraction"] == 1.0
    assert {name for name, _ in heard[:-1]} <= {"progress"}
    assert {view["stage"] for _, view in heard[:-1]} <= {"waiting", "files", *STAGE_VERSIONS}
    assert client.get(job["links"]["self"]).json()["state"] == "done"
    result = client.get(job["links"]["result"])
    assert result.status_code == 200 and result.headers["content-type"] == kind
    assert client.delete(job["links"]["self"]).status_code == 204
    problem(client.get(job["links"]["self"]), 404, "not-found")


def test_a_job_is_made_only_of_what_takes_long(client, small):
    """RFC 7240, section 4.3: `wait` bounds how long the client waits before it is told of a job."""
    scene, patient = small | {"seed": 21}, {"prefer": "respond-async, wait=10"}
    answer = client.post("/v1/render", json=scene, headers=patient)
    assert answer.status_code == 200 and answer.headers["content-type"] == "image/png"
    again = client.post("/v1/render", json=scene, headers=ASYNC)
    assert again.status_code == 200, "what is kept needs no job"
    assert (again.content, again.headers["etag"]) == (answer.content, answer.headers["etag"])
    lines = [("prefer", 'wait="1"'), ("prefer", "Respond-Async")]
    hasty = client.post("/v1/render", json=slow(small, 22), headers=lines)
    assert hasty.status_code == 202
    other = client.post("/v1/render", json=small | {"seed": 23}, headers={"prefer": "not-respond-async"})
    assert other.status_code == 200
    assert client.delete(hasty.json()["links"]["self"]).status_code == 204
    wrong = small | {"mesh": {"source": {"builtin": "nothing.obj"}}}
    problem(client.post("/v1/render", json=wrong, headers=patient), 422, "invalid-parameters")


def test_result_too_early_then_cancelled(client, small):
    job = accepted(client, slow(small, 12), "/v1/render")
    problem(client.get(job["links"]["result"]), 409, "not-ready")
    answer = client.delete(job["links"]["self"])
    assert answer.status_code == 204 and not answer.content
    assert client.get(job["links"]["self"]).json()["state"] == "cancelled"
    body = problem(client.get(job["links"]["result"]), 409, "job-failed")
    assert body["cause"]["type"] == "/problems/job-failed"
    assert events(client, job)[-1][0] == "cancelled"


def test_failed_job_says_why(client, small):
    job = accepted(client, small | {"material": {"layers": [{"medium": "unobtainium"}]}})
    assert events(client, job)[-1][0] == "failed"
    body = problem(client.get(job["links"]["result"]), 409, "job-failed")
    assert body["cause"]["type"] == "/problems/invalid-parameters"
    assert "unobtainium" not in json.dumps(body)


def test_wrong_scenes_are_refused_before_a_job_is_made(client):
    problem(client.post("/v1/bake", json={"seed": -1}, headers=ASYNC), 422, "invalid-parameters")


def test_previews_are_served_between_the_steps_of_a_job(client, small):
    """A preview does not wait for the end of a job."""
    job = accepted(client, slow(small, 13), "/v1/render")
    while client.get(job["links"]["self"]).json()["state"] == "queued":
        time.sleep(0.02)
    assert client.post("/v1/render", json=small | {"seed": 14}).status_code == 200
    assert client.get(job["links"]["self"]).json()["state"] == "running"
    client.delete(job["links"]["self"])


def test_health_answers_while_rendering(client, small):
    """p99 of /healthz ≤ 100 ms at rest of the machine; here only that rendering does not block the loop."""
    job = accepted(client, slow(small, 15), "/v1/render")
    times = []
    for _ in range(50):
        start = time.monotonic()
        assert client.get("/healthz").status_code == 200
        times.append(time.monotonic() - start)
    client.delete(job["links"]["self"])
    assert sorted(times)[45] < 0.5


def test_reader_that_leaves_a_stream_leaks_nothing(server, client, small):
    job = accepted(client, slow(small, 16), "/v1/render")
    with server.client() as other, other.stream("GET", job["links"]["events"]) as stream:
        next(stream.iter_lines())
        open_files = len(list(Path(f"/proc/{server.process.pid}/fd").iterdir()))
    deadline = time.monotonic() + 10
    while len(list(Path(f"/proc/{server.process.pid}/fd").iterdir())) >= open_files:
        assert time.monotonic() < deadline, "the stream's socket is still open"
        time.sleep(0.05)
    assert client.get(job["links"]["self"]).json()["state"] in ("queued", "running", "done")  # it goes on
    assert client.delete(job["links"]["self"]).status_code == 204
    assert "texsss_jobs_unfinished 0.0" in client.get("/metrics").text
