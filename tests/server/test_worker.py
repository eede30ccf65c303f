"""The render thread's order and its places, with work that does nothing but wait."""

import asyncio
import threading
import time
from collections.abc import Callable

import pytest
from texsss_server.assets import Store
from texsss_server.jobs import Jobs
from texsss_server.problems import Problem
from texsss_server.settings import Settings
from texsss_server.worker import Turn, Worker

from texsss.errors import AssetError


def with_worker(check: Callable, **places: int) -> None:
    """Runs `check(worker, running, go)` on a loop: `running` work has begun, and ends after `go`."""

    async def main() -> None:
        worker = Worker(lambda: "engine", **{"places": 2, "jobs": 2, "wait_s": 0.1} | places)  # pyright: ignore
        worker.start()
        go, begun = threading.Event(), threading.Event()

        def step(engine: object, turn: Turn) -> str:
            begun.set()
            go.wait(10)
            return "done"

        running = asyncio.ensure_future(worker.run(step, Turn(60)))
        await asyncio.to_thread(begun.wait, 10)
        try:
            await check(worker, running, go)
        finally:
            go.set()
            await running
            worker.close()

    thread = threading.Thread(
        target=lambda: caught.append(outcome(main))
    )  # browsers leave a loop in this one
    caught: list[BaseException | None] = []
    thread.start()
    thread.join()
    if caught[0] is not None:
        raise caught[0]


def outcome(main: Callable) -> BaseException | None:
    try:
        asyncio.run(main())
    except BaseException as error:  # raised again by the test
        return error
    return None


async def ended(work: asyncio.Future) -> str:
    with pytest.raises(Problem) as told:
        await work
    return told.value.slug


def nothing(engine: object, turn: Turn) -> str:
    return "made"


def test_newer_drafts_take_the_places_of_older_ones_at_once():
    async def check(worker, running, go):
        drafts = []
        for _ in range(6):
            drafts.append(asyncio.ensure_future(worker.run(nothing, Turn(60, drafts_of="a"))))
            await asyncio.sleep(0.01)
        assert [await ended(draft) for draft in drafts[:-1]] == ["superseded"] * 5
        assert not running.done()
        go.set()
        assert await drafts[-1] == "made"

    with_worker(check)


def test_jobs_that_are_cancelled_while_they_wait_give_their_places_back():
    took: list[dict[str, float]] = []

    async def check(worker, running, go):
        jobs = Jobs(Settings(jobs=2), worker, took.append)
        first = [await jobs.start("bake", nothing) for _ in range(2)]
        await asyncio.sleep(0.05)
        for job in first:
            jobs.remove(job)
        await asyncio.sleep(0.05)
        again = [await jobs.start("bake", nothing) for _ in range(2)]
        await asyncio.sleep(0.2)
        assert [job.state for job in (*first, *again)] == ["cancelled"] * 2 + ["queued"] * 2
        go.set()
        while not all(job.finished for job in again):
            await asyncio.sleep(0.01)
        assert [job.state for job in again] == ["done"] * 2 and len(took) == 4

    with_worker(check)


def test_what_waits_is_dropped_by_a_stop():
    async def check(worker, running, go):
        turn = Turn(60)
        waiting = asyncio.ensure_future(worker.run(nothing, turn))
        await asyncio.sleep(0.02)
        start = time.monotonic()
        worker.stop(turn, "timeout")
        assert await ended(waiting) == "render-timeout" and time.monotonic() - start < 1
        assert worker.waiting == 0 and not running.done()

    with_worker(check)


def test_a_disk_that_fills_up_at_the_description_leaves_nothing(tmp_path, monkeypatch):
    store = Store(Settings(assets_dir=tmp_path))

    async def chunks():
        yield b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

    def full(asset: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "_describe", full)
    thread = threading.Thread(target=lambda: caught.append(outcome(lambda: store.add("a.obj", chunks()))))
    caught: list[BaseException | None] = []
    thread.start()
    thread.join()
    store.close()
    assert isinstance(caught[0], Problem) and caught[0].slug == "storage-full"
    assert not list(tmp_path.iterdir()) and store.bytes_used == 0
    with pytest.raises(AssetError, match="upload it again"):
        store.path("0" * 64)
