"""A service that is told to stop while a job runs: what was promised is delivered. The last test stops it."""

import io
import json
import signal
import threading
import time
from collections.abc import Iterator

import httpx
import pytest
from PIL import Image
from serving import Running, end, launch, problem, until_ready

BYTES = {"content-type": "application/octet-stream"}
JOB = {"atlas": {"size": 256}, "camera": {"resolution": [200, 150], "samples": 1}}


@pytest.fixture(scope="module")
def ending(tmp_path_factory) -> Iterator[Running]:
    running = launch(tmp_path_factory.mktemp("ending"), "ending", parse_memory_mb=40)
    try:
        yield until_ready(running)
    finally:
        end(running)


def test_image_that_needs_more_memory_than_its_reader_has(ending):
    """16 megapixels: 64 MB as numbers, and 16 kB as a file."""
    file = io.BytesIO()
    Image.new("L", (4000, 4000)).save(file, "PNG")
    with ending.client() as client:

        def upload(data: bytes, name: str) -> httpx.Response:
            return client.post("/v1/assets", params={"name": name}, content=data, headers=BYTES)

        told = problem(upload(file.getvalue(), "large.png"), 422, "parse-limit")
        assert "40 MB" in told["reason" if "reason" in told else "detail"]
        assert upload(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "small.obj").status_code == 201


def test_stop_lets_a_job_finish_and_its_result_be_fetched(ending):
    with ending.client() as client:
        job = client.post("/v1/render", json=JOB, headers={"prefer": "respond-async"}).json()
        heard: list[str] = []

        def follow() -> None:
            with ending.client() as other, other.stream("GET", job["links"]["events"]) as stream:
                heard.extend(line for line in stream.iter_lines() if line.startswith("event: "))

        follower = threading.Thread(target=follow)
        follower.start()
        while (state := client.get(job["links"]["self"]).json()["state"]) == "queued":
            time.sleep(0.02)
        assert state == "running"
        ending.process.send_signal(signal.SIGTERM)
        follower.join(20)
        assert heard[-1] == "event: done"
        metrics = client.get("/metrics").text
        assert 'texsss_stage_seconds_count{stage="picture"} 1.0' in metrics  # of jobs, too
        result = client.get(job["links"]["result"])
        assert result.status_code == 200 and result.content.startswith(b"\x89PNG")
    start = time.monotonic()
    assert ending.process.wait(20) in (0, -signal.SIGTERM)
    assert time.monotonic() - start < 8  # not the grace of 20 seconds: nothing is owed any more
    logged = [json.loads(line) for line in ending.log.read_text().splitlines() if line.startswith("{")]
    assert not [line for line in logged if line["level"] in ("error", "critical")]
