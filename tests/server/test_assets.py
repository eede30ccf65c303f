"""Uploads: kept by content, read in a limited child, refused with a reason."""

import hashlib
import io
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import zipfile

import httpx
import pytest
from obj_files import torus_obj
from PIL import Image
from serving import problem, quick

BINARY = {"content-type": "application/octet-stream"}


def upload(client: httpx.Client, data: bytes, name: str, kind: str = "application/octet-stream"):
    return client.post("/v1/assets", params={"name": name}, content=data, headers={"content-type": kind})


def png(width: int = 8, height: int = 8, mode: str = "RGB") -> bytes:
    out = io.BytesIO()
    Image.new(mode, (width, height), 200).save(out, "PNG")
    return out.getvalue()


def test_mesh_is_kept_by_its_content(client):
    data = torus_obj(around=20)
    first, again = upload(client, data, "a.obj", "model/obj"), upload(client, data, "b.obj")
    assert first.status_code == 201 and again.status_code == 200
    body = first.json()
    assert body["asset"] == hashlib.sha256(data).hexdigest() == again.json()["asset"]
    assert first.headers["location"] == f"/v1/assets/{body['asset']}"
    assert (body["kind"], body["faces"], body["bytes"]) == ("mesh", 2 * 20 * 12, len(data))
    assert client.get(first.headers["location"]).json() == body
    content = client.get(f"{first.headers['location']}/content")
    assert content.content == data and content.headers["x-content-type-options"] == "nosniff"
    # content is named by itself: known to whoever has it, and never sent in parts
    where, tag = f"{first.headers['location']}/content", content.headers["etag"]
    assert client.get(where, headers={"if-none-match": tag}).status_code == 304
    for part in ("bytes=0-3", "bytes=9999-", "lines=1"):
        whole = client.get(where, headers={"range": part})
        assert whole.status_code == 200 and whole.content == data
    assert client.delete(first.headers["location"]).status_code == 204
    problem(client.get(first.headers["location"]), 404, "not-found")
    scene = quick({"asset": body["asset"]})
    lost = problem(client.post("/v1/render", json=scene), 422, "invalid-parameters")
    assert lost["errors"][0]["code"] == "unknown-asset"


def test_map_in_a_scene(client, small):
    asset = upload(client, png(), "albedo.png", "image/png").json()
    assert (asset["kind"], asset["width"], asset["channels"]) == ("map", 8, 3)
    maps = {"albedo": {"source": {"asset": asset["asset"]}, "space": "srgb"}}
    material = {"layers": [{"medium": "skin1"}], "surface": {"albedo": "albedo"}}
    answer = client.post("/v1/render", json=small | {"maps": maps, "material": material})
    assert answer.status_code == 200, answer.text


@pytest.mark.parametrize(
    "name, data, status, slug",
    [
        ("a.obj", b"", 422, "invalid-mesh"),
        ("a.obj", b"hello\n", 422, "invalid-mesh"),
        ("a.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", 422, "invalid-mesh"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", 422, "invalid-mesh"),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 1 << 30), 422, "invalid-mesh"),
        ("a.glb", b"glTF" + struct.pack("<II", 2, 1 << 31) + b"\0" * 276, 422, "invalid-mesh"),
        ("a.png", b"\x89PNG\r\n\x1a\n garbage", 422, "invalid-map"),
        ("a.exr", b"v/1\x01" + b"\0" * 100, 422, "invalid-map"),
        ("a.gltf", b"{}", 415, "unsupported-mesh"),
        ("a.fbx", b"Kaydara FBX", 415, "unsupported-mesh"),
        ("a.zip", b"PK\x03\x04", 415, "unsupported-mesh"),
        ("a.svg", b"<svg/>", 415, "unsupported-mesh"),
        ("a.obj", b"PK\x03\x04" + b"\0" * 100, 415, "unsupported-mesh"),
        ("a.obj", b"<x3d/>", 415, "unsupported-mesh"),
        ("a.obj", b"\x89PNG\r\n\x1a\n", 415, "unsupported-mesh"),
        ("a.glb", b"v 0 0 0\n", 415, "unsupported-mesh"),
        ("a.png", b"\xff\xd8\xff\xe0", 415, "unsupported-map"),
    ],
)
def test_bad_files(client, name, data, status, slug):
    body = problem(upload(client, data, name), status, slug)
    assert slug not in ("invalid-mesh", "invalid-map") or body["reason"]


def test_picture_as_mesh_is_refused_though_known_as_map(client):
    assert upload(client, png(4, 4), "a.png").status_code in (200, 201)
    problem(upload(client, png(4, 4), "a.obj"), 415, "unsupported-mesh")


def test_an_upload_is_used_as_what_it_was_read_as(client, small):
    """One file may be both: a map of one pixel that goes on as an OBJ. No limit of meshes was put to it."""
    both = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x80\x80\x80\x80\n"
    both += b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    asset = upload(client, both, "both.hdr")
    assert asset.status_code == 201, asset.text
    source = {"asset": asset.json()["asset"]}
    told = problem(
        client.post("/v1/render", json=small | {"mesh": {"source": source}}), 422, "invalid-parameters"
    )
    assert told["errors"][0]["code"] == "wrong-kind" and "uploaded as a map" in told["detail"]


def test_too_many_pixels(client):
    """A small file of 5000² pixels is told by its header."""
    body = problem(upload(client, png(5000, 5000, "1"), "bomb.png"), 413, "asset-too-large")
    assert body["limit"] == 4096**2 and body["actual"] == 5000**2 and body["unit"] == "pixels"


def test_zip_bomb_is_no_mesh(client):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("a.obj", b"\0" * (1 << 24))
    problem(upload(client, out.getvalue(), "bomb.obj"), 415, "unsupported-mesh")


@pytest.mark.parametrize("kind", ["text/plain", "multipart/form-data; boundary=x", "application/json", ""])
def test_content_type_of_uploads(client, kind):
    answer = client.post(
        "/v1/assets?name=a.obj", content=b"x", headers={"content-type": kind} if kind else {}
    )
    problem(answer, 415, "unsupported-media-type")
    assert "model/*" in answer.headers["accept-post"]


@pytest.mark.parametrize(
    "query", ["", "name=", "name=x&more=1", "name=a.obj&name=b.obj", "name=" + "a" * 300]
)
def test_upload_query(client, query):
    answer = client.post(f"/v1/assets?{query}", content=b"x", headers=BINARY)
    problem(answer, 422, "invalid-parameters")


def test_names_are_only_shown(client):
    """Slashes and markup in a name reach no file and no page."""
    answer = upload(client, torus_obj(around=21), "../../<b>evil</b>.obj")
    assert answer.status_code == 201
    assert "/" not in answer.json()["name"] and "<" not in answer.json()["name"]


def test_client_killed_in_mid_stream_leaves_nothing(server, client):
    address = server.url.removeprefix("http://").split(":")
    before = client.get("/metrics").text
    with socket.create_connection(address) as wire:
        head = "POST /v1/assets?name=a.obj HTTP/1.1\r\nHost: localhost\r\nContent-Type: model/obj\r\n"
        wire.sendall(f"{head}Content-Length: 1000000\r\n\r\n".encode() + b"v 0 0 0\n" * 100)
        deadline = time.monotonic() + 5
        while not list(server.assets.glob(".texsss-upload-*")):
            assert time.monotonic() < deadline, "the upload never began"
            time.sleep(0.01)
        wire.setsockopt(
            socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
        )  # reset, as kill -9 does
    deadline = time.monotonic() + 5
    while list(server.assets.glob(".texsss-upload-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not list(server.assets.glob(".texsss-upload-*"))
    assert held(before) == held(client.get("/metrics").text)


def held(metrics: str) -> str:
    return next(line for line in metrics.splitlines() if line.startswith("texsss_asset_bytes "))


def test_killed_reader_is_told_and_replaced(server, client):
    """kill -9 of the child that reads: a 4xx or 201 for that upload, and the next one is read."""
    heavy = torus_obj(around=600, through=200)
    answers = []
    thread = threading.Thread(target=lambda: answers.append(upload(client, heavy, "heavy.obj")))
    thread.start()
    deadline = time.monotonic() + 10
    while thread.is_alive() and time.monotonic() < deadline:
        for pid in server.descendants():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        time.sleep(0.02)
    thread.join()
    problem(answers[0], 422, "parse-limit")
    assert upload(client, torus_obj(around=22), "next.obj").status_code == 201
    assert not list(server.assets.glob(".texsss-upload-*"))


def test_full_disk_is_told(server, client):
    """A disk that takes no more, simulated by a limit on the size of files."""
    old = resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
    try:
        problem(upload(client, torus_obj(around=23), "full.obj"), 507, "storage-full")
    finally:
        resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, old)
    assert not list(server.assets.glob(".texsss-upload-*"))
    assert upload(client, torus_obj(around=23), "full.obj").status_code == 201


def test_every_bad_file_is_a_4xx_or_a_mesh(shared_data, tmp_path, server, client):
    """All files of make_nasty.py: told within 10 s by the table's slugs, and the server lives."""
    subprocess.run([sys.executable, str(shared_data / "make_nasty.py"), str(tmp_path)], check=True)
    told: dict[int, int] = {}
    for path in sorted(path for path in tmp_path.rglob("*") if path.is_file()):
        start = time.monotonic()
        answer = upload(client, path.read_bytes(), path.name)
        assert time.monotonic() - start < 10, path
        if answer.status_code not in (200, 201):
            slug = answer.json()["type"].removeprefix("/problems/")
            problem(answer, answer.status_code, slug)
            assert 400 <= answer.status_code < 500, (path, answer.text)
        told[answer.status_code] = told.get(answer.status_code, 0) + 1
    assert sum(told.values()) > 150 and client.get("/healthz").status_code == 200
    assert not list(server.assets.glob(".texsss-upload-*"))
