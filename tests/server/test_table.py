"""The table of behaviours: status, slug and body of every case that needs no tight limits."""

import asyncio
import io
import json
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from PIL import Image
from serving import problem
from texsss_server.app import create_app
from texsss_server.settings import Settings

JSON = {"content-type": "application/json"}


def post(client, content, headers=JSON, path="/v1/render"):
    return client.post(path, content=content, headers=headers)


@pytest.mark.parametrize("body", [b"", b"{", b"{]", b"{} {}", b"nul", b"'a'", b'{"a": 01}'])
def test_malformed_json(client, body):
    problem(post(client, body), 400, "malformed-json")


@pytest.mark.parametrize(
    "body",
    [
        b'{"seed": "\xff\xfe"}',
        b"\xff\xfe{\x00}\x00",
        b"[" * 100_000,
        b'{"a":' * 500 + b"1" + b"}" * 500,
        b'{"seed": ' + b"1" * 10_000 + b"}",
    ],
    ids=["utf-8", "utf-16", "deep list", "deep object", "digits"],
)
def test_malformed_body(client, body):
    problem(post(client, body), 400, "malformed-body")


def test_bodies_are_not_unpacked(client):
    problem(post(client, b"{}", JSON | {"content-encoding": "gzip"}), 415, "unsupported-media-type")


@pytest.mark.parametrize("start, item", [('{"lights": [', "0,"), ('{"material": {"layers": [', "0,")])
def test_a_body_of_many_faults_holds_nobody_up(client, start, item):
    """A megabyte of them once took seconds of the loop that answers everyone."""
    text = start + item * 100_000 + "0]}" + "}" * start.count("material")
    began = time.monotonic()
    told = problem(post(client, text.encode()), 400, "malformed-body")
    assert "10,000 values" in told["detail"] and time.monotonic() - began < 1


@pytest.mark.parametrize(
    "text, pointer",
    [
        ('{"atlas": {"size": 0}}', "/atlas/size"),
        ('{"atlas": {"size": 99999}}', "/atlas/size"),
        ('{"atlas": {"size": 4096}}', "/atlas/size"),
        ('{"atlas": {"size": true}}', "/atlas/size"),
        ('{"atlas": {"size": "64"}}', "/atlas/size"),
        ('{"atlas": {"size": 64.5}}', "/atlas/size"),
        ('{"atlas": {"size": null}}', "/atlas/size"),
        ('{"atlas": {"zise": 64}}', "/atlas/zise"),
        ('{"atlas": []}', "/atlas"),
        ('{"frobnicate": 1}', "/frobnicate"),
        ('{"output": {"exposure_ev": NaN}}', "/output/exposure_ev"),
        ('{"output": {"exposure_ev": Infinity}}', "/output/exposure_ev"),
        ('{"output": {"exposure_ev": 1e400}}', "/output/exposure_ev"),
        ('{"output": {"tonemap": "\\ud800"}}', "/output/tonemap"),
        ('{"\\ud800": 1}', ""),
        ('{"material": {"layers": []}}', "/material/layers"),
        (
            '{"material": {"layers": [{"medium": "skin1", "thickness_mm": -1}]}}',
            "/material/layers/0/thickness_mm",
        ),
        ('{"lights": [{"type": "point", "position_mm": [1, "2", 3]}]}', "/lights/0/position_mm/1"),
        ('{"lights": [{"type": "laser"}]}', "/lights/0"),
        ('{"camera": {"resolution": [8000, 8000]}}', "/camera/resolution"),
        ('{"camera": {"resolution": [2000, 2000], "samples": 64}}', "/camera/samples"),
        ('{"mesh": null}', "/mesh"),
        ('{"mesh": {"source": {}}}', "/mesh/source"),
        ('{"mesh": "/etc/passwd"}', "/mesh/source/path"),
        ('{"mesh": {"source": {"path": "x.obj"}}}', "/mesh/source/path"),
        ('{"maps": {"a/b": {"source": {"path": "x.png"}}}}', "/maps/a~1b/source/path"),
        ('{"mesh": {"source": {"asset": "' + "0" * 64 + '"}}}', "/mesh/source/asset"),
        ('{"version": 2}', "/version"),
        ('{"version": true}', "/version"),
        ("null", ""),
        ("[]", ""),
        ("1", ""),
    ],
)
def test_invalid_parameters(client, text, pointer):
    """A pointer to the place, and nothing of what was sent."""
    body = problem(post(client, text.encode()), 422, "invalid-parameters")
    assert pointer in {error["pointer"] for error in body["errors"]}
    assert all(error["in"] == "body" and error["code"] and error["detail"] for error in body["errors"])
    assert all(set(error) == {"pointer", "in", "code", "detail"} for error in body["errors"])


@pytest.mark.parametrize(
    "scene",
    [
        {"material": "unobtainium"},
        {"mesh": {"source": {"builtin": "unobtainium"}}},
        {"methods": {"profile": "unobtainium"}},
        {"material": {"surface": {"albedo": "unobtainium"}}},
        {"mesh": {"source": {"builtin": "axolotl/axolotl.obj"}, "up": "unobtainium"}},
    ],
)
def test_what_was_sent_is_not_repeated(client, small, scene):
    body = problem(client.post("/v1/render", json=small | scene), 422, "invalid-parameters")
    assert "unobtainium" not in body["detail"]
    assert not any("unobtainium" in error["detail"] for error in body["errors"])


def test_options_that_lack_something_are_told(client, small):
    body = problem(
        client.post("/v1/render", json=small | {"methods": {"diffusion": "parallax"}}),
        422,
        "invalid-parameters",
    )
    assert body["errors"][0]["code"] == "DomainError"


def test_messages_name_no_folders_of_ours(server, client, small):
    """An upload that was damaged on disk: the library's sentence has its path, ours only the file's name."""
    image = io.BytesIO()
    Image.new("RGB", (5, 3)).save(image, "PNG")
    headers = {"content-type": "image/png"}
    asset = client.post("/v1/assets?name=hole.png", content=image.getvalue(), headers=headers).json()["asset"]
    (server.assets / f"{asset}.png").write_bytes(image.getvalue()[:40])
    scene = small | {
        "maps": {"a": {"source": {"asset": asset}}},
        "material": {"surface": {"albedo": "a"}},
    }
    body = problem(client.post("/v1/render", json=scene), 422, "invalid-parameters")
    assert f"{asset}.png: expected" in body["detail"]
    assert "/tmp" not in json.dumps(body) and "of ours" not in json.dumps(body)
    client.delete(f"/v1/assets/{asset}")


def test_names_of_a_scene_are_bounded(client, small):
    """A body of many names costs little, and is not sent back."""
    maps = {f"secret{n}": {"source": {"asset": "0" * 64}} for n in range(257)}
    body = problem(client.post("/v1/render", json=small | {"maps": maps}), 422, "invalid-parameters")
    assert body["errors"][0]["pointer"] == "/maps"
    maps.pop("secret256")
    told = problem(client.post("/v1/render", json=small | {"maps": maps}), 422, "invalid-parameters")
    assert len(told["errors"]) == 50
    lights = [{"type": "environment", "map": "nothing"}]
    answer = client.post("/v1/render", json=small | {"maps": maps, "lights": lights})
    assert "secret" not in problem(answer, 422, "invalid-parameters")["detail"]


@pytest.mark.parametrize(
    "query", ["image=nonsense", "image=gaussian-0", "quality=best", "frobnicate=1", "image=picture&image="]
)
def test_query_parameters_are_checked(client, small, query):
    body = problem(client.post(f"/v1/render?{query}", json=small), 422, "invalid-parameters")
    assert body["errors"][0]["in"] == "query"


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", "", "application/xml"])
@pytest.mark.parametrize("path", ["/v1/render", "/v1/bake", "/v1/profile", "/v1/inspect"])
def test_content_type(client, path, kind):
    answer = post(client, b"{}", {"content-type": kind} if kind else {}, path)
    problem(answer, 415, "unsupported-media-type")
    assert "application/json" in answer.headers["accept-post"]


def test_json_with_charset_is_json(client, small):
    headers = {"content-type": "Application/JSON; charset=utf-8"}
    assert post(client, json.dumps(small).encode(), headers).status_code == 200


@pytest.mark.parametrize("path", ["/v1/render", "/v1/bake", "/v1/profile", "/v1/inspect"])
def test_accept(client, small, path):
    body = problem(client.post(path, json=small, headers={"accept": "image/gif"}), 406, "not-acceptable")
    assert body["available"]
    refused = client.post(
        path, json=small, headers={"accept": ", ".join(f"{a};q=0" for a in body["available"])}
    )
    problem(refused, 406, "not-acceptable")


@pytest.mark.parametrize(
    "path", ["/nope", "/v1", "/v1/render/", "/v1/jobs/x", "/v1/jobs/x/events", "/v1/assets/x"]
)
def test_unknown_paths(client, path):
    problem(client.get(path), 404, "not-found")


def test_unknown_job_result_and_delete(client):
    problem(client.get("/v1/jobs/x/result"), 404, "not-found")
    problem(client.delete("/v1/jobs/x"), 404, "not-found")
    problem(client.delete(f"/v1/assets/{'0' * 64}"), 404, "not-found")
    problem(client.get(f"/v1/assets/{'0' * 64}/content"), 404, "not-found")
    problem(client.get("/v1/assets/..%2f..%2fetc%2fpasswd"), 404, "not-found")


@pytest.mark.parametrize(
    "method, path, allow",
    [
        *(("GET", "/v1/render", "POST"), ("PUT", "/v1/bake", "POST"), ("DELETE", "/healthz", "GET, HEAD")),
        *(("PATCH", "/v1/assets/x", "DELETE, GET"), ("POST", "/v1/jobs/x", "DELETE, GET")),
        ("BREW", "/v1/scenes", "GET"),
    ],
)
def test_wrong_method(client, method, path, allow):
    answer = client.request(method, path)
    problem(answer, 405, "method-not-allowed")
    assert answer.headers["allow"] == allow


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
def test_probes_may_ask_for_the_head_alone(client, path):
    whole, head = client.get(path), client.head(path)
    assert (head.status_code, head.content) == (whole.status_code, b"")
    assert head.headers["content-length"] == whole.headers["content-length"]


@pytest.mark.parametrize("path", ["/openapi.json", "/"])
def test_wrong_method_beside_the_api(client, path):
    answer = client.post(path)
    problem(answer, 405, "method-not-allowed")
    assert "GET" in answer.headers["allow"]


def test_errors_among_the_page_s_files_are_not_kept(client):
    problem(client.get("/assets/nope-12345678.js"), 404, "not-found")


def test_thousands_of_faults_are_told_at_once(client):
    """The loop answers everyone: a body of faults must not hold it."""
    many = {f"k{i}": "x" * 20 for i in range(9_000)}
    for body in (many, {"maps": {str(i): {} for i in range(9_000)}}, {"media": many}):
        start = time.monotonic()
        answer = client.post("/v1/profile", json=body)
        told = problem(answer, 422, "invalid-parameters")
        assert 1 <= len(told["errors"]) <= 50 and "more)" in told["detail"]
        assert time.monotonic() - start < 2  # .1 to .3 s alone


def test_choices_are_named_though_the_body_names_them_too(client):
    answer = client.post("/v1/render", json={"summary": "uv", "methods": {"diffusion": "nope"}})
    assert "'uv'" in problem(answer, 422, "invalid-parameters")["detail"]


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost.evil:80", "[::2]", ""])
def test_foreign_host(client, host):
    problem(client.get("/healthz", headers={"host": host}), 400, "bad-host")


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:123", "127.0.0.1:9", "[::1]:8000"])
def test_own_hosts(client, host):
    assert client.get("/healthz", headers={"host": host}).text == "ok"


def test_security_headers_everywhere(client, small):
    client.headers["origin"] = "https://elsewhere.example"
    for answer in (client.get("/healthz"), client.get("/nope"), client.post("/v1/render", json=small)):
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert answer.headers["x-request-id"]
        assert "access-control-allow-origin" not in answer.headers and "server" not in answer.headers


def test_no_page_loads_anything_from_elsewhere(client):
    for path in ("/docs", "/redoc"):
        problem(client.get(path), 404, "not-found")


def test_starting(server):
    """The socket opens before torch is there: alive, not ready."""
    problem(server.first_ready, 503, "starting")
    assert int(server.first_ready.headers["retry-after"]) > 0
    assert server.first_alive.status_code == 200


def test_what_breaks_inside_is_a_500(server, client):
    """A description that is a folder: nothing that we look for, in a server as it runs."""
    name = "e" * 64
    (server.assets / f"{name}.json").mkdir()
    body = problem(client.get(f"/v1/assets/{name}"), 500, "internal")
    assert "of ours" not in json.dumps(body)
    (server.assets / f"{name}.json").rmdir()


@pytest.fixture
def own() -> Iterator[FastAPI]:
    """An application in this process, to break."""
    app = create_app(Settings(warm=False))
    yield app
    app.state.service.store.close()


def asked(app: FastAPI, method: str, path: str, **options: Any) -> httpx.Response:
    """What an application of this process answers."""

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.request(method, path, **options)

    with ThreadPoolExecutor(1) as pool:  # a browser that was tested before has a loop in this thread
        return pool.submit(lambda: asyncio.run(ask())).result()


def test_what_nobody_expected_is_a_500_without_its_trace(own, caplog):
    def broken(asset: str) -> None:
        raise RuntimeError(f"the secret folder of {asset}")

    own.state.service.store.get = broken
    answer = asked(own, "GET", f"/v1/assets/{'0' * 64}")
    problem(answer, 500, "internal")
    assert "secret" not in answer.text and "the secret folder" in caplog.text


def test_a_body_that_a_stop_cuts_off_is_told(own):
    """As uvicorn cancels what is still arriving after the time that a stop may take."""

    async def body():
        yield b"{"
        own.state.service.stopping = True
        raise asyncio.CancelledError

    answer = asked(own, "POST", "/v1/profile", headers=JSON, content=body())
    problem(answer, 503, "stopping")
    assert answer.headers["retry-after"] == "5"


def test_health_and_metrics(client):
    assert client.get("/healthz").status_code == 200
    assert client.get("/readyz").text == "ready"
    text = client.get("/metrics").text
    assert 'route="/v1/jobs/{job}"' in text  # the template, not the id
    assert "texsss_cache_bytes" in text and "texsss_stage_seconds" in text


def test_logs_are_json_with_the_request_id(server, client):
    name = client.get("/healthz").headers["x-request-id"]
    time.sleep(0.05)
    lines = [json.loads(line) for line in server.log.read_text().splitlines() if line.startswith("{")]
    (line,) = [line for line in lines if line["request"] == name]
    assert line["route"] == "/healthz" and line["status"] == 200 and line["ms"] >= 0


def test_garbage_on_the_wire(server, client):
    for junk in (
        b"\x00" * 100,
        b"GET\r\n\r\n",
        b"POST /v1/render HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
    ):
        with socket.create_connection(server.url.removeprefix("http://").split(":"), timeout=5) as wire:
            wire.sendall(junk)
            wire.shutdown(socket.SHUT_WR)
            assert b" 400 " in wire.recv(1000).split(b"\r\n")[0]
    assert client.get("/healthz").status_code == 200
