"""The process: uvicorn around the application, with a stop that lets work finish."""

import asyncio
import ctypes
import logging
import resource
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn
from texsss_server.app import create_app
from texsss_server.connections import connections
from texsss_server.logs import configure
from texsss_server.service import Service
from texsss_server.settings import Settings, unknown

from texsss.ahead import Ahead
from texsss.errors import DomainError

log = logging.getLogger("texsss.server")
POLL_S = 0.05
AFTER_CANCEL_S = 10
HEAPS = 2
M_ARENA_MAX = -8  # of glibc's mallopt


class Server(uvicorn.Server):
    """On the first signal: not ready any more; what runs is finished and its result may be fetched, or it is
    cancelled after the grace period."""

    def __init__(self, config: uvicorn.Config, service: Service, ahead: Ahead):
        super().__init__(config)
        self.service, self.ahead = service, ahead
        self._stopping: asyncio.Future | None = None

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Around everything; the signal that ended it is raised again afterwards, and may end the process."""
        with super().capture_signals():
            try:
                yield
            finally:
                self.ahead.stop()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Opens the socket."""
        self._loop = asyncio.get_running_loop()
        await super().startup(sockets)
        if self.started:
            host = f"[{self.config.host}]" if ":" in self.config.host else self.config.host
            log.info(f"listening on http://{host}:{self.config.port} (Ctrl+C stops)")

    def handle_exit(self, sig: int, frame: object) -> None:
        """The signal handler: a second signal, or an early one, stops at once."""
        if self.service.stopping or not self.started:
            self.service.worker.stop_all("stopping")
            return super().handle_exit(sig, frame)  # pyright: ignore[reportArgumentType]
        self._loop.call_soon_threadsafe(self._begin, sig, frame)

    def _begin(self, sig: int, frame: object) -> None:
        self.service.begin_stop()
        log.info("stopping", extra={"signal": signal.Signals(sig).name, "busy": self.service.worker.busy})
        self._stopping = asyncio.ensure_future(self._stop(sig, frame))

    async def _stop(self, sig: int, frame: object) -> None:
        worker, jobs, began = self.service.worker, self.service.jobs, time.monotonic()
        deadline = began + self.service.settings.grace_s
        while (worker.busy or jobs.owes(began)) and time.monotonic() < deadline:
            await asyncio.sleep(POLL_S)
        try:
            worker.stop_all("stopping")
            jobs.stop()
        finally:
            super().handle_exit(sig, frame)  # pyright: ignore[reportArgumentType]


def share_heaps() -> None:
    """Lets all threads share a few heaps; else each keeps for itself what it freed: hundreds of MB."""
    try:
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, HEAPS)
    except (OSError, AttributeError):
        log.info("this system's allocator is left as it is")


def open_files() -> None:
    """As many open files as the system lets us have: idle connections hold one each."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def listening(host: str, port: int) -> socket.socket:
    """A socket that is bound before anything is loaded. Raises DomainError: when it cannot be."""
    bound = None
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
    except OSError as error:
        if bound is not None:
            bound.close()
        raise DomainError(
            f"Settings: nothing can listen on {host}, port {port} ({error.strerror}); choose others with "
            "--host and --port."
        ) from None
    return bound


def serve(settings: Settings, ahead: Ahead) -> None:
    """Runs until it is told to stop, and stops what is built ahead.

    Raises DomainError, AssetError: when the settings cannot serve.
    """
    configure(settings.log_format)
    for name in unknown():
        log.warning(f"{name} is no setting; see docs/service.md")
    share_heaps()
    open_files()
    bound = listening(settings.host, settings.port)
    app = create_app(settings)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        http=connections(settings, app.state.service.metrics.refused),
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=AFTER_CANCEL_S,
    )
    Server(config, app.state.service, ahead).run(sockets=[bound])
