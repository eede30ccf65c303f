"""Connections: how many there may be, how long a request's header may take, what cannot be read."""

import asyncio
import contextlib
import fcntl
import logging
import secrets
import termios
from array import array
from collections.abc import Callable
from typing import Any

import h11
from texsss_server.logs import request_id
from texsss_server.middleware import API_CSP, SECURITY
from texsss_server.problems import Problem, retry_after
from texsss_server.settings import Settings
from uvicorn.protocols.http.h11_impl import H11Protocol

log = logging.getLogger("texsss.server")


class Connection(H11Protocol):
    """HTTP/1.1 whose refusals are problems like all others; what precedes an application is decided here.

    Time runs from the opening of a connection, or from a request's first byte, to the end of its header,
    and while a client takes nothing of its answer; bodies have limits of their own, idle connections
    uvicorn's. `refused` hears the status of what is answered here.
    """

    settings: Settings
    refused: Callable[[int], None]

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, **options)
        self._late: asyncio.TimerHandle | None = None
        self._stuck: asyncio.TimerHandle | None = None
        self._heard = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Counts it among the others."""
        super().connection_made(transport)
        if len(self.connections) > self.settings.connections:
            self._refuse(retry_after("too-many-connections", "Too many connections are open; close some.", 5))
        else:
            self._watch()

    def data_received(self, data: bytes) -> None:
        """Reads a part of a request."""
        self._heard = True
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forgets it."""
        super().connection_lost(exc)
        self._unwatch()
        self.resume_writing()

    def pause_writing(self) -> None:
        """Lets time run while an answer waits for its reader."""
        super().pause_writing()
        self._await_reader(self._unread())

    def resume_writing(self) -> None:
        """The reader has taken it."""
        super().resume_writing()
        if self._stuck is not None:
            self._stuck.cancel()
            self._stuck = None

    def send_400_response(self, msg: str) -> None:
        """The answer to what is no HTTP."""
        self._refuse(Problem("malformed-request", "Expected one sound HTTP/1.1 request."))

    def _watch(self) -> None:
        """Lets time run while a header is under way."""
        if self.conn.their_state is not h11.IDLE or self.transport.is_closing():
            self._unwatch()
        elif self._late is None:
            self._late = self.loop.call_later(self.settings.header_timeout_s, self._too_late)

    def _unwatch(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _too_late(self) -> None:
        if not self._heard:  # browsers open some to spare
            self.transport.close()
            return
        detail = f"Expected the whole header within {self.settings.header_timeout_s:g} s."
        self._refuse(Problem("request-timeout", detail))

    def _await_reader(self, waiting: int) -> None:
        self._stuck = self.loop.call_later(self.settings.read_timeout_s, self._ask_reader, waiting)

    def _ask_reader(self, before: int) -> None:
        """Leaves a client that has taken nothing of its answer."""
        waiting = self._unread()
        if waiting < before:
            self._await_reader(waiting)
        else:
            log.info("connection left: its client reads nothing", extra={"bytes": waiting})
            self.transport.abort()

    def _unread(self) -> int:
        """Bytes of answers that its client has yet to take, the system's among them."""
        unsent = array("i", [0])
        with contextlib.suppress(OSError):
            fcntl.ioctl(self.transport.get_extra_info("socket").fileno(), termios.TIOCOUTQ, unsent)
        return self.transport.get_write_buffer_size() + unsent[0]

    def _refuse(self, problem: Problem) -> None:
        """Answers, unless an answer has begun, and closes."""
        name = secrets.token_hex(8)
        request_id.set(name)
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            answer = problem.response(name)
            headers = {"x-request-id": name, "connection": "close", "content-security-policy": API_CSP}
            given = [(key.encode(), value.encode()) for key, value in {**SECURITY, **headers}.items()]
            told = h11.Response(status_code=problem.status, headers=answer.raw_headers + given)
            is_head = self.conn.our_state is h11.SEND_RESPONSE and self.scope["method"] == "HEAD"
            body = [] if is_head else [h11.Data(data=bytes(answer.body))]
            for event in (told, *body, h11.EndOfMessage()):
                self.transport.write(self.conn.send(event) or b"")
            self.refused(problem.status)
        log.info("connection refused", extra={"status": problem.status, "reason": problem.slug})
        self.transport.close()


def connections(settings: Settings, refused: Callable[[int], None]) -> type[Connection]:
    """The protocol of a server with these settings."""
    return type("Connection", (Connection,), {"settings": settings, "refused": staticmethod(refused)})
