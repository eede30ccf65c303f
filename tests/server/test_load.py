"""Mixed load: eight clients that hit, edit, upload, err, leave and make jobs, all at once.

Ten seconds in the suite; TEXSSS_LOAD_S=300 is the whole, on a server of its own that has warmed up and whose
caches are so small that they are full after a minute: what memory grows by then would be lost.
"""

import json
import os
import random
import threading
import time
from collections import Counter
from collections.abc import Iterator

import httpx
import pytest
from obj_files import torus_obj
from serving import OBJ, Running, end, launch, problem, quick, until_idle, until_ready

SECONDS = float(os.environ.get("TEXSSS_LOAD_S", "10"))
CLIENTS = 8
MINUTE = 60
MAY_BE = {200, 201, 202, 204, 304, 400, 404, 409, 413, 415, 422, 429, 503}


@pytest.fixture
def loaded(request, tmp_path) -> Iterator[Running]:
    """The usual server for a short load; for a long one, a server with small caches."""
    if SECONDS <= MINUTE:
        yield request.getfixturevalue("server")
        return
    running = launch(tmp_path, "loaded", cache_mb=64, answers_mb=8, jobs_mb=8, assets_mb=16, warm=True)
    try:
        yield until_idle(until_ready(running))
    finally:
        end(running)


def followed(client: httpx.Client, job: dict, deleted: bool) -> str:
    """The last event of a job's stream; `forgotten` if this client deleted it after its end."""
    last = ""
    with client.stream("GET", job["links"]["events"]) as events:
        if events.status_code == 404 and deleted:
            return "forgotten"
        assert events.status_code == 200, "an accepted job is lost"
        for line in events.iter_lines():
            if line.startswith("event: "):
                last = line.removeprefix("event: ")
            elif line.startswith("data: ") and last == "failed":
                assert json.loads(line.removeprefix("data: "))["problem"]["detail"]
    return last


def test_mixed_load(loaded, torus):
    """No 5xx but 503; memory settles; every accepted job ends; health answers."""
    server = loaded
    asset = httpx.post(f"{server.url}/v1/assets?name=torus.obj", content=torus, headers=OBJ, timeout=60)
    small = quick({"asset": asset.json()["asset"]})
    counts: Counter[int] = Counter()
    wrong: list[str] = []
    ends: Counter[str] = Counter()
    health: list[float] = []
    memory: list[tuple[float, float]] = []
    start = time.monotonic()

    def one(client: httpx.Client, dice: random.Random) -> httpx.Response | None:
        match dice.choice(["hit", "hit", "material", "light", "upload", "bad", "abort", "job", "draft"]):
            case "hit":
                return client.post("/v1/render", json=small, headers={"accept": "image/jpeg"})
            case "material":
                layers = [
                    {"medium": dice.choice(["skin1", "marble"]), "thickness_mm": dice.randint(1, 50) / 10}
                ]
                return client.post("/v1/render", json=small | {"material": {"layers": layers}})
            case "light":
                lamp = {"type": "directional", "direction": [dice.randint(-9, 9), 3, dice.randint(1, 9)]}
                return client.post("/v1/render", json=small | {"lights": [lamp]})
            case "upload":
                data, headers = torus_obj(around=dice.randint(3, 30)), {"content-type": "model/obj"}
                return client.post("/v1/assets?name=t.obj", content=data, headers=headers)
            case "bad":
                body = dice.choice([b"{", b"[]", b'{"seed": "x"}', b"\xff"])
                return client.post("/v1/render", content=body, headers={"content-type": "application/json"})
            case "abort":
                slow = small | {"seed": dice.randint(0, 10**6), "atlas": {"size": 256}}
                try:
                    return client.post("/v1/render", json=slow, timeout=0.05)
                except httpx.TimeoutException:
                    return None
            case "job":
                new = small | {"seed": dice.randint(0, 10**6)}  # else the first one's result would answer
                answer = client.post("/v1/bake", json=new, headers={"prefer": "respond-async"})
                if answer.status_code == 202:
                    job = answer.json()
                    deleted = dice.random() < 0.2
                    if deleted:
                        client.delete(job["links"]["self"])
                    ends[followed(client, job, deleted)] += 1
                return answer
        headers = {"x-client-id": dice.choice("ab")}
        body = small | {"seed": dice.randint(0, 50)}
        return client.post("/v1/render?quality=draft", json=body, headers=headers)

    def work(number: int) -> None:
        dice = random.Random(number)
        with server.client() as client:
            while time.monotonic() - start < SECONDS:
                answer = one(client, dice)
                if answer is None:
                    continue
                counts[answer.status_code] += 1
                if answer.status_code >= 400:
                    problem(answer, answer.status_code, answer.json()["type"].removeprefix("/problems/"))
                if answer.status_code not in MAY_BE:
                    wrong.append(answer.text)

    def watch() -> None:
        with server.client() as client:
            while time.monotonic() - start < SECONDS:
                began = time.monotonic()
                client.get("/healthz")
                health.append(time.monotonic() - began)
                memory.append((began - start, server.memory_mb()))
                time.sleep(0.1)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(CLIENTS)]
    threads.append(threading.Thread(target=watch))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong and counts[200] > 10, (wrong[:3], counts)
    slowest = sorted(health)[int(0.99 * (len(health) - 1))]
    by_minute = [
        max(mb for at, mb in memory if at // MINUTE == n) for n in range(int(SECONDS // MINUTE) or 1)
    ]
    print(f"{dict(counts)}, jobs {dict(ends)}, healthz p99 {1000 * slowest:.0f} ms, MB by minute {by_minute}")
    assert set(ends) <= {"done", "failed", "cancelled", "forgotten"} and sum(ends.values()) == counts[202], (
        ends
    )
    half = [max(mb for at, mb in memory if (at > SECONDS / 2) == late) for late in (False, True)]
    assert max(by_minute) <= 1.1 * by_minute[0] and half[1] <= 1.5 * half[0]
    assert slowest < 1.0  # 0.1 on a machine of one's own
    assert not list(server.assets.glob(".texsss-upload-*"))
