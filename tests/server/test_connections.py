"""Connections by themselves: an application that sends more than its client reads, and requests cut short."""

import asyncio
import socket
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
import uvicorn
from texsss_server.connections import connections
from texsss_server.settings import Settings
from uvicorn.server import ServerState

LARGE = 32 << 20  # bytes, more than sockets hold


async def large(scope, receive, send) -> None:
    """An application whose answer is large, after the whole request."""
    while (await receive()).get("more_body"):
        pass
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": bytes(LARGE)})


def serving(
    use: Callable[[socket.socket, ServerState], Awaitable[None]], patience_s: float = 0.1
) -> list[int]:
    """What was refused while `use` talked to a server of `large` that waits so long for a client."""
    refused: list[int] = []

    async def run() -> None:
        kind = connections(Settings(read_timeout_s=patience_s), refused.append)
        config, state = uvicorn.Config(large, lifespan="off", log_config=None), ServerState()
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: kind(config, state, {}), "127.0.0.1", 0)
        async with server:
            with socket.socket() as wire:
                wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                wire.setblocking(False)
                await loop.sock_connect(wire, server.sockets[0].getsockname())
                await asyncio.wait_for(use(wire, state), 10)

    with ThreadPoolExecutor(1) as pool:  # a browser that was tested before has a loop in this thread
        pool.submit(lambda: asyncio.run(run())).result()
    return refused


def test_a_client_that_reads_nothing_is_left():
    async def use(wire: socket.socket, state: ServerState) -> None:
        await asyncio.get_running_loop().sock_sendall(wire, b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
        await asyncio.sleep(0.05)
        assert len(state.connections) == 1
        while state.connections:
            await asyncio.sleep(0.02)

    assert serving(use) == []


def test_a_client_that_reads_slowly_gets_everything():
    async def use(wire: socket.socket, state: ServerState) -> None:
        loop, size = asyncio.get_running_loop(), 0
        await loop.sock_sendall(wire, b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
        for _ in range(20):  # takes longer than one may take nothing
            size += len(await loop.sock_recv(wire, 1 << 16))
            await asyncio.sleep(0.05)
        while part := await loop.sock_recv(wire, 1 << 20):
            size += len(part)
            if size > LARGE:
                return
        pytest.fail("it was cut off")

    assert serving(use, patience_s=0.6) == []  # busy machines pause for some tenths


def test_head_with_a_broken_body_is_answered_without_one():
    async def use(wire: socket.socket, state: ServerState) -> None:
        loop, text = asyncio.get_running_loop(), b""
        head = b"HEAD / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"
        await loop.sock_sendall(wire, head)
        while part := await loop.sock_recv(wire, 4096):
            text += part
        assert text.startswith(b"HTTP/1.1 400") and text.endswith(b"\r\n\r\n")

    assert serving(use) == [400]
