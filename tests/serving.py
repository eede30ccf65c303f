"""A real uvicorn in a process of its own, asked over loopback; and what its tests share."""

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

START_S = 120


@dataclass
class Running:
    """A server process: where it listens, what it said first, and its log."""

    url: str
    process: subprocess.Popen
    log: Path
    assets: Path
    first_ready: httpx.Response
    first_alive: httpx.Response

    def client(self, **headers: str) -> httpx.Client:
        return httpx.Client(base_url=self.url, timeout=60, headers=headers)

    def memory_mb(self) -> float:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split("VmRSS:")[1].split()[0]) / 1024

    def descendants(self) -> list[int]:
        """Process ids below the server's."""
        found, waiting = [], [self.process.pid]
        while waiting:
            pid = waiting.pop()
            for task in Path(f"/proc/{pid}/task").glob("*/children"):
                below = [int(child) for child in task.read_text().split()]
                found += below
                waiting += below
        return found


def free_port() -> int:
    """A port of loopback that nothing listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def launch(folder: Path, name: str, **settings: object) -> Running:
    """Starts `texsss serve` with settings by environment; returns when the socket answers."""
    port = settings.pop("port", None) or free_port()
    assets = folder / f"{name} assets of ours"  # blanks, which messages must not stumble over
    given = {"assets_dir": assets, "host": "127.0.0.1", "port": port, "threads": 1, "warm": False, **settings}
    environment = os.environ | {f"TEXSSS_{key.upper()}": str(value) for key, value in given.items()}
    log = folder / f"{name}.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "texsss", "serve"], cwd=folder, env=environment, stdout=out, stderr=out
        )
    url, deadline = f"http://127.0.0.1:{port}", time.monotonic() + START_S
    while True:
        try:
            ready, alive = (httpx.get(f"{url}/{path}", timeout=5) for path in ("readyz", "healthz"))
            return Running(url, process, log, assets, ready, alive)
        except httpx.TransportError:
            if process.poll() is not None or time.monotonic() > deadline:
                pytest.fail(f"the server did not start:\n{log.read_text()}")
            time.sleep(0.05)


def until_ready(running: Running) -> Running:
    """Waits for the render thread."""
    deadline = time.monotonic() + START_S
    while (answer := httpx.get(f"{running.url}/readyz")).status_code != 200:
        if time.monotonic() > deadline or "could not start" in answer.text:
            pytest.fail(f"the server is not ready:\n{running.log.read_text()}")
        time.sleep(0.1)
    return running


def until_idle(running: Running) -> Running:
    """Waits for what is done in the background."""
    deadline = time.monotonic() + START_S
    idle = [f"texsss_{what} 0.0" for what in ("running", "waiting")]
    while not all(line in httpx.get(f"{running.url}/metrics").text for line in idle):
        if time.monotonic() > deadline:
            pytest.fail(f"the server is still busy:\n{running.log.read_text()}")
        time.sleep(0.1)
    return running


def end(running: Running) -> None:
    """Ends a server that is still there."""
    if running.process.poll() is None:
        running.process.send_signal(signal.SIGTERM)
        try:
            running.process.wait(15)
        except subprocess.TimeoutExpired:
            running.process.kill()
            running.process.wait()


KEY = "open sesame"
STRICT = {
    "api_key": KEY,
    "body_mb": 0.002,
    "body_timeout_s": 1,
    "header_timeout_s": 1,
    "connections": 60,
    "upload_mb": 0.01,
    "upload_timeout_s": 1,
    "queue": 1,
    "render_timeout_s": 0.4,
    "max_faces": 200,
    "max_map_pixels": 100,
    "cors_origins": "https://studio.example",
    "jobs": 2,
    "grace_s": 1.5,
    "parse_timeout_s": 1,
    "job_ttl_s": 1,
}


OBJ = {"content-type": "model/obj"}


def quick(source: dict) -> dict:
    """A tiny picture of a mesh."""
    return {
        "mesh": {"source": source, "unit_mm": 1.0},
        "atlas": {"size": 64},
        "material": {"layers": [{"medium": "skin1"}]},
        "camera": {"resolution": [64, 48], "samples": 1},
    }


def problem(response: httpx.Response, status: int, slug: str) -> dict:
    """The body of a problem, after checking everything that all problems share."""
    assert response.status_code == status, response.text[:500]
    assert response.headers["content-type"] == "application/problem+json"
    assert response.headers["cache-control"] == "no-store"
    body = response.json()
    assert body["type"] == f"/problems/{slug}" and body["status"] == status
    assert body["title"] and body["detail"]
    assert body["instance"] == f"urn:request:{response.headers['x-request-id']}"
    assert "Traceback" not in response.text and ".py" not in response.text
    return body
