"""What a service with tight limits says; the last test stops it."""

import asyncio
import json
import os
import signal
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from serving import KEY, problem, quick
from texsss_server.settings import Settings, of_options

from texsss.errors import DomainError

LIMIT = 2097  # 0.002 MB
SLOW = {
    "atlas": {"size": 1024},
    "material": {"layers": [{"medium": "marble"}]},
    "camera": {"resolution": [800, 600], "samples": 4},
}


@pytest.mark.parametrize("key", [None, "", "Bearer", "Bearer wrong", f"Basic {KEY}", f"bearer {KEY}x"])
def test_key_is_asked_for(strict, key):
    headers = {} if key is None else {"authorization": key}
    for path in ("/v1/presets", "/metrics", "/v1/nope"):
        answer = httpx.get(strict.url + path, headers=headers)
        problem(answer, 401, "unauthorized")
        assert answer.headers["www-authenticate"] == "Bearer"


def test_health_needs_no_key(strict, tight):
    assert httpx.get(f"{strict.url}/healthz").status_code == 200
    assert httpx.get(f"{strict.url}/readyz").status_code == 200
    assert tight.get("/v1/presets").status_code == 200


def test_the_description_asks_for_the_key(strict):
    document = httpx.get(f"{strict.url}/openapi.json").json()
    assert document["paths"]["/v1/render"]["post"]["security"] == [{"key": []}]
    assert "security" not in document["paths"]["/healthz"]["get"]
    assert document["components"]["securitySchemes"]["key"]["scheme"] == "bearer"


def test_cors_only_where_allowed(tight):
    def allowed(origin: str) -> str | None:
        return tight.get("/v1/schema", headers={"origin": origin}).headers.get("access-control-allow-origin")

    assert allowed("https://studio.example") == "https://studio.example"
    assert allowed("https://evil.example") is None


def test_preflights_that_are_refused_are_problems(tight):
    asks = {"origin": "https://evil.example", "access-control-request-method": "POST"}
    problem(tight.options("/v1/render", headers=asks), 403, "origin-refused")
    allowed = tight.options("/v1/render", headers=asks | {"origin": "https://studio.example"})
    assert allowed.status_code == 200


def test_pages_elsewhere_can_read_refusals(strict):
    origin = {"origin": "https://studio.example"}
    for headers, status in (({}, 401), ({"host": "evil.example"}, 400)):
        answer = httpx.get(f"{strict.url}/v1/presets", headers=origin | headers)
        assert answer.status_code == status
        assert answer.headers["access-control-allow-origin"] == "https://studio.example"
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_key_may_be_any_text_but_none():
    with pytest.raises(DomainError, match="api_key"):
        of_options(api_key="")
    with pytest.raises(DomainError, match="cache_mb"):
        of_options(cache_mb=float("inf"))


def test_what_a_service_is_unless_told(monkeypatch):
    for name in [name for name in os.environ if name.startswith("TEXSSS_")]:
        monkeypatch.delenv(name)
    settings = Settings()
    assert settings.host == "127.0.0.1" and settings.cors_origins == () and settings.api_key is None


def test_body_too_large_as_announced(tight):
    body = b'{"a": "' + b"x" * LIMIT + b'"}'
    answer = tight.post("/v1/render", content=body, headers={"content-type": "application/json"})
    told = problem(answer, 413, "body-too-large")
    assert told["limit"] == LIMIT and told["actual"] == len(body)
    assert answer.headers["connection"] == "close"


def test_body_too_large_in_chunks(tight):
    def chunks():
        for _ in range(100):
            yield b" " * 100

    answer = tight.post("/v1/render", content=chunks(), headers={"content-type": "application/json"})
    assert problem(answer, 413, "body-too-large")["limit"] == LIMIT
    assert answer.headers["connection"] == "close"


@pytest.mark.parametrize(
    "path, kind", [("/v1/render", "application/json"), ("/v1/assets?name=a.obj", "model/obj")]
)
def test_slow_body(strict, path, kind):
    """A client that sends a byte and waits hears 408 after the second that it has."""
    address = strict.url.removeprefix("http://").split(":")
    with socket.create_connection(address, timeout=10) as wire:
        head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {KEY}\r\n"
        wire.sendall(f"{head}Content-Type: {kind}\r\nContent-Length: 50\r\n\r\n{{".encode())
        start = time.monotonic()
        heard = b""
        while part := wire.recv(4096):
            heard += part
    assert b" 408 " in heard.split(b"\r\n")[0] and b"/problems/request-timeout" in heard
    assert 0.9 < time.monotonic() - start < 5


def heard(wire: socket.socket) -> tuple[int | None, dict]:
    """Status and problem of what a server says before it closes; None if it says nothing."""
    text = b""
    while part := wire.recv(4096):
        text += part
    if not text:
        return None, {}
    head, body = text.split(b"\r\n\r\n", 1)
    assert b"application/problem+json" in head and b"x-request-id" in head and b"connection: close" in head
    return int(head.split()[1]), json.loads(body)


@pytest.mark.parametrize(
    "sent, status, slug",
    [
        (b"", None, None),
        (b"GET /healthz HTTP/1.1\r\nHost: loc", 408, "request-timeout"),
        (b"\x16\x03\x01\x00\xa5\x01\r\n\r\n", 400, "malformed-request"),  # TLS
        (b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", 400, "malformed-request"),
    ],
)
def test_connections_that_bring_no_request(strict, sent, status, slug):
    with socket.create_connection(strict.url.removeprefix("http://").split(":"), timeout=10) as wire:
        wire.sendall(sent)
        found, told = heard(wire)
    assert found == status
    assert told.get("type") == (slug and f"/problems/{slug}")


def test_more_connections_than_there_may_be(strict):
    address = strict.url.removeprefix("http://").split(":")
    idle = [socket.create_connection(address, timeout=10) for _ in range(60)]
    try:
        with socket.create_connection(address, timeout=10) as wire:
            status, told = heard(wire)
        assert status == 503 and told["type"] == "/problems/too-many-connections"
    finally:
        for wire in idle:
            wire.close()
    assert httpx.get(f"{strict.url}/healthz").status_code == 200


def test_upload_limits(tight):
    def upload(data: bytes, name: str) -> httpx.Response:
        headers = {"content-type": "application/octet-stream"}
        return tight.post("/v1/assets", params={"name": name}, content=data, headers=headers)

    told = problem(upload(b"#" * 20_000, "a.obj"), 413, "asset-too-large")
    assert told["limit"] == int(0.01 * 2**20) and told["actual"] == 20_000
    fan = "v 0 0 0\n" + "".join(f"v {i} 1 {i % 7}\n" for i in range(202))
    fan += "".join(f"f 1 {i} {i + 1}\n" for i in range(2, 203))
    told = problem(upload(fan.encode(), "fan.obj"), 413, "asset-too-large")
    assert told["limit"] == 200 and told["actual"] == 201 and told["unit"] == "faces"


def test_reader_that_takes_too_long_is_told_and_replaced(strict, tight):
    """A file that keeps its reader busy, simulated by readers that are held."""
    triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

    def upload(text: bytes) -> httpx.Response:
        headers = {"content-type": "model/obj"}
        return tight.post("/v1/assets", params={"name": "a.obj"}, content=text, headers=headers)

    assert upload(triangle + b"# one").status_code == 201
    for pid in strict.descendants():
        os.kill(pid, signal.SIGSTOP)
    start = time.monotonic()
    problem(upload(triangle + b"# two"), 422, "parse-limit")
    assert 0.9 < time.monotonic() - start < 10
    assert upload(triangle + b"# two").status_code == 201


def test_finished_jobs_expire(tight):
    job = tight.post("/v1/bake", json=SLOW, headers={"prefer": "respond-async"}).headers["location"]
    assert tight.delete(job).status_code == 204
    assert tight.get(job).json()["state"] == "cancelled"
    time.sleep(1.2)
    problem(tight.get(job), 404, "not-found")


def test_render_timeout(tight):
    answer = tight.post("/v1/render", json=SLOW | {"seed": 1})
    told = problem(answer, 503, "render-timeout")
    assert int(answer.headers["retry-after"]) > 0 and "0.4 s" in told["detail"]


def test_queue_full_after_a_wait(strict):
    """One runs, one waits, the others hear 429 after a quarter of a second."""

    async def all_at_once() -> list[tuple[int, float, httpx.Response]]:
        async with httpx.AsyncClient(
            base_url=strict.url, headers={"authorization": f"Bearer {KEY}"}, timeout=60
        ) as client:

            async def ask(number: int):
                start = time.monotonic()
                answer = await client.post("/v1/render", json=SLOW | {"seed": 20 + number})
                return answer.status_code, time.monotonic() - start, answer

            return await asyncio.gather(*(ask(number) for number in range(10)))

    with ThreadPoolExecutor(1) as pool:  # a browser that was tested before has a loop in this thread
        answers = pool.submit(lambda: asyncio.run(all_at_once())).result()
    refused = [(seconds, answer) for status, seconds, answer in answers if status == 429]
    assert refused and {status for status, _, _ in answers} <= {429, 503}
    for seconds, answer in refused:
        problem(answer, 429, "queue-full")
        assert int(answer.headers["retry-after"]) >= 1 and seconds > 0.24


def test_too_many_jobs(tight):
    jobs = [tight.post("/v1/bake", json=SLOW, headers={"prefer": "respond-async"}) for _ in range(3)]
    assert [job.status_code for job in jobs[:2]] == [202, 202]
    problem(jobs[2], 429, "queue-full")
    for job in jobs[:2]:
        assert tight.delete(job.headers["location"]).status_code == 204


def test_stop_finishes_cancels_and_tells(strict, tight):
    """SIGTERM: not ready but alive, no new work; a long job is cancelled after the grace, its stream ends."""
    slow = SLOW | {"atlas": {"size": 2048}, "camera": {"resolution": [2000, 2000], "samples": 10}}
    job = tight.post("/v1/render", json=slow, headers={"prefer": "respond-async"}).json()
    ended: list[str] = []

    def follow() -> None:
        client = strict.client(authorization=f"Bearer {KEY}")
        with client, client.stream("GET", job["links"]["events"]) as stream:
            ended.extend(line for line in stream.iter_lines() if line.startswith("event: "))

    thread = threading.Thread(target=follow)
    thread.start()
    while tight.get(job["links"]["self"]).json()["state"] == "queued":
        time.sleep(0.05)
    strict.process.send_signal(signal.SIGTERM)
    time.sleep(0.3)
    answer = tight.get("/readyz")
    problem(answer, 503, "stopping")
    assert int(answer.headers["retry-after"]) > 0
    assert tight.get("/healthz").status_code == 200
    problem(tight.post("/v1/render", json=quick({"builtin": "axolotl/axolotl.obj"})), 503, "stopping")
    thread.join(20)
    assert not thread.is_alive() and ended[-1] in ("event: stopping", "event: failed")
    assert strict.process.wait(20) == 0 or strict.process.returncode == -signal.SIGTERM
    logged = [json.loads(line) for line in strict.log.read_text().splitlines() if line.startswith("{")]
    assert any(line["message"] == "stopping" for line in logged)
    assert not [line for line in logged if line["level"] in ("error", "critical")]
