"""Around every request: an id, security headers, a log line, metrics; checks at the door, a last resort."""

import asyncio
import hmac
import logging
import secrets
import time
from typing import TYPE_CHECKING

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from texsss_server.logs import request_id
from texsss_server.problems import Problem, retry_after

if TYPE_CHECKING:
    from texsss_server.service import Service

log = logging.getLogger("texsss.server")

API = ("/v1/", "/metrics", "/openapi.json", "/healthz", "/readyz")
LOCKED = ("/v1/", "/metrics")
SECURITY = {
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-frame-options": "DENY",
}
API_CSP = "default-src 'none'; frame-ancestors 'none'"
PAGE_CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Envelope:
    """The outermost layer; nothing leaves without passing it: it names, dresses and notes every answer."""

    def __init__(self, app: ASGIApp, service: "Service"):
        self.app, self.service = app, service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        name = secrets.token_hex(8)
        request_id.set(name)
        scope.setdefault("state", {})["request_id"] = name
        start, status = time.perf_counter(), 0

        async def sending(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                self._dress(MutableHeaders(scope=message), scope["path"], name, status < 400)
            await send(message)

        try:
            await self.app(scope, receive, sending)
        finally:
            self._note(scope, status, time.perf_counter() - start)

    def _dress(self, headers: MutableHeaders, path: str, name: str, is_success: bool) -> None:
        headers["x-request-id"] = name
        for header, value in SECURITY.items():
            headers.setdefault(header, value)
        headers["content-security-policy"] = API_CSP if path.startswith(API) else PAGE_CSP
        if path.startswith("/assets/") and is_success:
            headers["cache-control"] = "public, max-age=31536000, immutable"  # named by their content
        elif not path.startswith(API):
            headers.setdefault("cache-control", "no-cache")  # the page names those assets

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "path", "unmatched")
        status = status or 499
        self.service.metrics.request(scope["method"], route, status, seconds)
        told = {"method": scope["method"], "route": route, "status": status, "ms": round(1000 * seconds, 1)}
        log.info("request", extra=told)


class Origins(CORSMiddleware):
    """Cross-origin headers; a refusal before the request itself is a problem like every other."""

    def preflight_response(self, request_headers: Headers) -> Response:
        """The answer to OPTIONS."""
        answer = super().preflight_response(request_headers)
        if answer.status_code < 400:
            return answer
        detail = "Expected an origin, a method and headers that are allowed; see TEXSSS_CORS_ORIGINS."
        return Problem("origin-refused", detail, headers={"vary": "Origin"}).response(request_id.get())


class Gate:
    """Who is let in, and what is said when something breaks behind it.

    It stands within cross-origin headers, so that a page elsewhere can read these answers too.
    """

    def __init__(self, app: ASGIApp, service: "Service"):
        self.app, self.service = app, service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        name, started = scope["state"]["request_id"], False

        async def sending(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            problem = self._refusal(scope)
            app = self.app if problem is None else problem.response(name)
            await app(scope, receive, sending)
        except asyncio.CancelledError:
            if started or not self.service.stopping:
                raise
            late = retry_after("stopping", "The service is stopping; ask again in a moment.", 5)
            await late.response(name)(scope, receive, send)
        except Exception:
            log.exception("unexpected error", extra={"path": scope["path"]})
            if not started:
                broken = Problem("internal", "Something broke here; tell us the instance below.")
                await broken.response(name)(scope, receive, send)

    def _refusal(self, scope: Scope) -> Problem | None:
        """Why a request is not let in."""
        headers, settings = Headers(scope=scope), self.service.settings
        if "*" not in settings.allowed_hosts and _host(headers) not in settings.allowed_hosts:
            return Problem("bad-host", "Expected a Host that is served here; see TEXSSS_ALLOWED_HOSTS.")
        if settings.api_key and scope["path"].startswith(LOCKED) and scope["method"] != "OPTIONS":
            scheme, _, key = headers.get("authorization", "").partition(" ")
            # headers are read as Latin-1, byte by byte
            right = hmac.compare_digest(key.strip().encode("latin-1"), settings.api_key.encode())
            if scheme.lower() != "bearer" or not right:
                detail = "Expected the header Authorization: Bearer KEY."
                return Problem("unauthorized", detail, headers={"www-authenticate": "Bearer"})
        return None


def _host(headers: Headers) -> str:
    """The name in Host without its port."""
    host = headers.get("host", "").lower()
    if host.startswith("["):
        inner, _, port = host[1:].partition("]")
        return inner if not port or port.startswith(":") else ""
    return host.rpartition(":")[0] if ":" in host else host
