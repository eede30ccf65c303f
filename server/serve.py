"""The process: uvicorn around the application, with a stop that lets work finish."""

import asyncio
import ctypes
import logging
import signal
import socket
import time

import uvicorn
from texsss_server.app import create_app
from texsss_server.logs import configure
from texsss_server.service import Service
from texsss_server.settings import Settings

log = logging.getLogger("texsss.server")
POLL_S = 0.05
AFTER_CANCEL_S = 10
HEAPS = 2
M_ARENA_MAX = -8  # of glibc's mallopt


class Server(uvicorn.Server):
    """On the first signal: not ready any more; what runs is finished and its result may be fetched, or it is
    cancelled after the grace period."""

    def __init__(self, config: uvicorn.Config, service: Service):
        super().__init__(config)
        self.service = service
        self._stopping: asyncio.Future | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Opens the socket."""
        self._loop = asyncio.get_running_loop()
        await super().startup(sockets)

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


def serve(settings: Settings) -> None:
    """Runs until it is told to stop."""
    configure(settings.log_format)
    share_heaps()
    app = create_app(settings)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=AFTER_CANCEL_S,
    )
    Server(config, app.state.service).run()
