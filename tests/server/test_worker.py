"""The render thread's order and its places, with work that does nothing but wait."""

import asyncio
import gc
import threading
import time
import weakref
from collections.abc import Callable

import pytest
import torch
from texsss_server.answers import Answer, Answers
from texsss_server.assets import Store
from texsss_server.encode import encoded
from texsss_server.examine import Asset
from texsss_server.jobs import Job, Jobs
from texsss_server.problems import Problem
from texsss_server.settings import Settings
from texsss_server.turn import JOB, Turn
from texsss_server.worker import Worker

from texsss.errors import AssetError, Cancelled


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


def test_a_newer_draft_takes_a_place_or_leaves_the_older_one():
    """With the queue full of others' work: 429 for the newer draft, and the older one still runs."""

    async def check(worker, running, go):
        older = asyncio.ensure_future(worker.run(nothing, Turn(60, drafts_of="a")))
        await asyncio.sleep(0.02)
        newer = asyncio.ensure_future(worker.run(nothing, Turn(60, drafts_of="a")))
        assert await ended(older) == "superseded"  # its place is taken, not given to who waits for one
        other = Turn(60, drafts_of="b")
        late = asyncio.ensure_future(worker.run(nothing, other))
        await asyncio.sleep(0.02)
        worker.stop(other, "gone")
        assert await ended(late) == "queue-full" or other.reason == "gone"
        go.set()
        assert await newer == "made"

    with_worker(check, places=1)


def test_a_draft_without_a_place_supersedes_nothing():
    async def check(worker, running, go):
        begun = threading.Event()

        def step(engine: object, turn: Turn) -> str:
            begun.set()
            while not go.is_set():
                time.sleep(0.01)
                if turn.stopped():
                    raise Cancelled("stopped")
            return "made"

        go.set()
        await running
        go.clear()
        draft = asyncio.ensure_future(worker.run(step, Turn(60, drafts_of="a")))
        await asyncio.to_thread(begun.wait, 5)
        waits = asyncio.ensure_future(worker.run(nothing, Turn(60)))
        await asyncio.sleep(0.02)
        assert (
            await ended(asyncio.ensure_future(worker.run(nothing, Turn(60, drafts_of="a")))) == "queue-full"
        )
        go.set()
        assert await draft == "made" and await waits == "made"

    with_worker(check, places=1)


def test_a_job_keeps_a_share_of_the_time_under_previews_without_end():
    async def check(worker, running, go):
        go.set()
        await running
        steps, stop = [], time.monotonic() + 4.5

        def job(engine: object, turn: Turn) -> str:
            turn.progress("bank", 0.0)
            while time.monotonic() < stop:
                steps.append(time.monotonic())
                time.sleep(0.01)
                turn.stopped()
            turn.progress("bank", 1.0)
            return "done"

        async def previews() -> None:
            while time.monotonic() < stop:
                await worker.run(lambda engine, turn: time.sleep(0.02), Turn(60))

        turn = Turn(1.0, patience=JOB)
        done = asyncio.ensure_future(worker.run(job, turn))
        await asyncio.gather(*(previews() for _ in range(3)))
        assert await done == "done"
        late = [step for step in steps if step > stop - 1.5]  # previews have had their credit by then
        assert 10 < len(late) < 60, len(late)  # a fifth of the time would be 30
        assert turn.reason is None, "others' time counts for its deadline"
        assert turn.seconds["bank"] < 2.5, "others' time counts for its stages"

    with_worker(check, places=4)


def test_a_failed_job_keeps_nothing_of_what_was_sent():
    class Body:
        pass

    async def check(worker, running, go):
        jobs = Jobs(Settings(), worker, lambda seconds: None)
        body = Body()
        held = weakref.ref(body)

        def fails(engine: object, turn: Turn, sent: object = body) -> str:
            raise Problem("internal", "broken")

        job = await jobs.start("bake", fails)
        del fails, body
        go.set()
        while not job.finished:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.05)
        gc.collect()
        assert job.state == "failed" and held() is None

    with_worker(check)


def test_work_that_exits_does_not_take_the_thread_along():
    async def check(worker, running, go):
        def leaves(engine: object, turn: Turn) -> str:
            raise SystemExit(1)

        go.set()
        with pytest.raises(RuntimeError, match="SystemExit"):
            await worker.run(leaves, Turn(60))
        assert worker.ready and await worker.run(nothing, Turn(60)) == "made"

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


def test_uploads_that_arrive_are_few_and_those_kept_are_counted(tmp_path):
    """One may arrive at a time here, and two are kept: the one used least recently goes."""
    store = Store(Settings(assets_dir=tmp_path, uploads=1, assets_count=2, queue_wait_s=0.05))
    store._examiner.examine = lambda digest, name, path: Asset(
        asset=digest, kind="mesh", name=name, bytes=path.stat().st_size
    )

    async def chunks(data: bytes, wait: float = 0.0):
        yield data
        await asyncio.sleep(wait)

    async def check() -> None:
        slow = asyncio.ensure_future(store.add("a.obj", chunks(b"first", 0.3)))
        await asyncio.sleep(0.02)
        with pytest.raises(Problem) as told:
            await store.add("b.obj", chunks(b"second"))
        assert told.value.slug == "queue-full"
        first, _ = await slow
        second, _ = await store.add("b.stl", chunks(b"second"))
        assert store.path(first.asset).suffix == ".obj" and store.path(second.asset).suffix == ".stl"
        again, is_new = await store.add("c.obj", chunks(b"first"))
        assert again == first and not is_new
        await store.add("d.obj", chunks(b"third"))
        assert store.get(second.asset) is None and store.get(first.asset) is not None
        assert len(list(tmp_path.iterdir())) == 4

    thread = threading.Thread(target=lambda: caught.append(outcome(check)))
    caught: list[BaseException | None] = []
    thread.start()
    thread.join()
    store.close()
    if caught[0] is not None:
        raise caught[0]


def test_a_disk_that_is_full_is_not_the_clients_fault(monkeypatch):
    def full(path: object, image: object, **options: object) -> None:
        raise AssetError("image.exr: could not be written: No space left on device.")

    monkeypatch.setattr("texsss_server.encode.write_exr", full)
    with pytest.raises(Problem) as told:
        encoded(torch.zeros(2, 2, 3), "image/x-exr")
    assert told.value.slug == "storage-full" and "exr" not in told.value.detail


def test_a_job_over_time_fails_and_says_so():
    async def check(worker, running, go):
        jobs = Jobs(Settings(job_timeout_s=0.2), worker, lambda seconds: None)

        def endless(engine: object, turn: Turn) -> str:
            while not turn.stopped():
                time.sleep(0.01)
            raise Cancelled("stopped")

        job = await jobs.start("bake", endless)
        go.set()
        while not job.finished:
            await asyncio.sleep(0.01)
        assert job.state == "failed" and job.problem.slug == "render-timeout"

    with_worker(check)


def test_finished_jobs_go_when_they_are_too_many_or_too_large(monkeypatch):
    async def check(worker, running, go):
        monkeypatch.setattr("texsss_server.jobs.MOST_FINISHED", 3)
        jobs = Jobs(Settings(jobs=10, jobs_mb=0.001), worker, lambda seconds: None)
        go.set()

        async def done(size: int) -> Job:
            job = await jobs.start("bake", lambda engine, turn: Answer(bytes(size), "image/png", None, {}))
            while not job.finished:
                await asyncio.sleep(0.01)
            return job

        made = [await done(10) for _ in range(5)]
        assert [jobs.get(job.id) is not None for job in made] == [False, False, True, True, True]
        large = [await done(800) for _ in range(2)]
        assert [jobs.get(job.id) is not None for job in (*made, *large)] == [False] * 6 + [True]

    with_worker(check, places=2, jobs=2)


def test_answers_asked_for_last_stay():
    answers = Answers(100)
    for name in "abc":
        answers.put(name, Answer(bytes(40), "image/png", None, {}))
        assert answers.get("a") is not None
    assert answers.get("b") is None and answers.get("c") is not None and answers.bytes_used == 80
