"""The service over loopback: how soon it is there, what edits of a cached scene cost, whether it stays awake.

python -m benchmarks.bench_service: processes of their own, the default scene at 512². Beside every figure
stands its limit; `stolen` is the share of time that a virtual machine's cores were given to others.
"""

import os
import socket
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

EDITS, HITS = 30, 200
JPEG = {"accept": "image/jpeg"}


@contextmanager
def served(**settings: object) -> Iterator[tuple[httpx.Client, dict[str, float]]]:
    """A client of a new server, and how long after its start [s] the socket answered and it was ready."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        given = {"port": probe.getsockname()[1], **settings}
    environment = os.environ | {f"TEXSSS_{name.upper()}": str(value) for name, value in given.items()}
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "texsss", "serve"], env=environment, stderr=subprocess.DEVNULL
    )
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{given['port']}", timeout=300) as client:
            yield client, {path: first_success(client, path) - start for path in ("/healthz", "/readyz")}
    finally:
        process.terminate()
        process.wait()


def first_success(client: httpx.Client, path: str) -> float:
    while True:
        try:
            if client.get(path).is_success:
                return time.perf_counter()
        except httpx.TransportError:
            pass
        time.sleep(0.02)


def until_idle(client: httpx.Client) -> None:
    """Waits for what is done in the background."""
    while not all(f"texsss_{what} 0.0" in client.get("/metrics").text for what in ("running", "waiting")):
        time.sleep(0.1)


def row(name: str, seconds: float | list[float], limit: str, more: str = "") -> None:
    if isinstance(seconds, float):
        print(f"{name:36s} {seconds:9.2f} s              limit {limit:8s} {more}", flush=True)
        return
    ordered = sorted(1000 * s for s in seconds)
    p50, p99 = statistics.median(ordered), ordered[int(0.99 * (len(ordered) - 1))]
    print(f"{name:36s} p50 {p50:6.1f}  p99 {p99:6.1f} ms   limit {limit:8s} {more}", flush=True)


def timed(ask: Callable[[], httpx.Response]) -> tuple[float, httpx.Response]:
    start = time.perf_counter()
    answer = ask()
    seconds = time.perf_counter() - start
    assert answer.status_code in (200, 304), answer.text
    return seconds, answer


def starts() -> None:
    """A start with default settings, and the first picture of a client that did not wait."""
    with served() as (client, after):
        row("socket answers, after the start", after["/healthz"], "")
        row("ready, after the start", after["/readyz"], "5 s")
        seconds, answer = timed(lambda: client.post("/v1/render", json={}))
        row("first render of the default scene", seconds, "6 s", answer.headers.get("server-timing", ""))


def edits(client: httpx.Client, scene: dict) -> None:
    """What a slider costs on a cached scene, as JPEG drafts."""

    def draft(changes: dict, **headers: str) -> tuple[float, httpx.Response]:
        ask = {"params": {"quality": "draft"}, "headers": JPEG | headers}
        return timed(lambda: client.post("/v1/render", json=scene | changes, **ask))

    def material(number: float) -> dict:
        layers = [{"medium": "skin1", "thickness_mm": 0.5 + number / 100}, {"medium": "skin2"}]
        return {"material": {"layers": layers, "surface": {"albedo": "albedo", "roughness": 0.35}}}

    def light(number: float) -> dict:
        return {"lights": [{"type": "directional", "direction": [number - EDITS / 2, 5.0, 10.0]}]}

    for name, change, limit in (("material", material, "100 ms"), ("light", light, "300 ms")):
        draft(change(-0.5))
        asked = [draft(change(float(number))) for number in range(EDITS)]
        row(f"{name} edit", [s for s, _ in asked], limit, asked[-1][1].headers.get("server-timing", ""))
    _, kept = draft(light(0.0))
    row("the same again", [draft(light(0.0))[0] for _ in range(HITS)], "5 ms")
    tag = {"if-none-match": kept.headers["etag"]}
    row("the same by its ETag", [draft(light(0.0), **tag)[0] for _ in range(HITS)], "5 ms")


def awake(client: httpx.Client) -> None:
    """/healthz while a new picture is made."""
    asked: list[float] = []
    heavy = {"seed": 1, "camera": {"resolution": [1600, 1200], "samples": 9}}
    thread = threading.Thread(target=lambda: client.post("/v1/render", json=heavy))
    thread.start()
    with httpx.Client(base_url=client.base_url) as other:
        while thread.is_alive():
            asked.append(timed(lambda: other.get("/healthz"))[0])
            time.sleep(0.02)
    row("/healthz while rendering", asked, "p99 100", f"{len(asked)} asked")


def stolen() -> tuple[int, int]:
    """Jiffies stolen, and all of them, since the machine started."""
    fields = [int(field) for field in Path("/proc/stat").read_text().split("\n")[0].split()[1:]]
    return fields[7], sum(fields[:8])


def main() -> None:
    before = stolen()
    starts()
    with served() as (client, _):
        until_idle(client)
        for diffusion in ("surface", "uv"):
            print(f"\ncached at 512², diffusion {diffusion}")
            scene = {"methods": {"diffusion": diffusion}}
            timed(lambda scene=scene: client.post("/v1/render", json=scene))
            edits(client, scene)
        awake(client)
    lost, passed = (after - was for after, was in zip(stolen(), before, strict=True))
    print(f"\nload {os.getloadavg()[0]:.1f}, stolen {lost / passed:.0%} of all cores' time")


if __name__ == "__main__":
    main()
