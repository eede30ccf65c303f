"""The application: routes, what surrounds them, and how problems become answers."""

from contextlib import asynccontextmanager
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Match, Route
from texsss_server import openapi
from texsss_server.middleware import Envelope, Gate, Origins
from texsss_server.problems import Problem, of_error
from texsss_server.routes import assets, bake, catalogue, health, jobs, render, study, viewer
from texsss_server.service import Service
from texsss_server.settings import Settings

from texsss.errors import TexsssError

PARTS = (render, bake, study, viewer, catalogue, assets, jobs, health)
STATIC = Path(__file__).parent / "static"
DESCRIPTION = "Layered subsurface scattering in the texture space of a mesh. A scene is the body everywhere."


def create_app(settings: Settings | None = None) -> FastAPI:
    """The ASGI application; it opens at once and is ready when the render thread is."""
    settings = settings or Settings()

    @asynccontextmanager
    async def lifespan(app: FastAPI):
        service.start()
        yield
        service.close()

    app = FastAPI(
        title="texsss",
        version=version("texsss"),
        description=DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,  # they load scripts from elsewhere
        redoc_url=None,
        redirect_slashes=False,
    )
    service = app.state.service = Service(settings)
    app.openapi = lambda: openapi.describe(app, settings.api_key is not None)
    for part in PARTS:
        app.include_router(part.router)
    if (STATIC / "index.html").is_file():
        app.frontend("/", directory=STATIC, fallback=None)
    else:
        app.add_api_route("/", _no_page, include_in_schema=False)
    app.add_middleware(Gate, service=service)
    if settings.cors_origins:
        app.add_middleware(
            Origins,
            allow_origins=list(settings.cors_origins),
            allow_methods=["GET", "POST", "DELETE"],
            allow_headers=["content-type", "authorization", "if-none-match", "prefer", "x-client-id"],
            expose_headers=["etag", "location", "retry-after", "server-timing", "x-request-id"],
        )
    app.add_middleware(Envelope, service=service)
    app.add_exception_handler(Problem, _problem)
    app.add_exception_handler(TexsssError, _library)
    app.add_exception_handler(RequestValidationError, _parameters)
    app.add_exception_handler(HTTPException, _http)
    return app


async def _no_page() -> None:
    raise Problem("not-found", "The page was not built; run `make page`, or install a released package.")


async def _problem(request: Request, problem: Exception) -> Response:
    assert isinstance(problem, Problem)
    return problem.response(request.state.request_id)


async def _library(request: Request, error: Exception) -> Response:
    assert isinstance(error, TexsssError)
    return await _problem(request, of_error(error))


async def _parameters(request: Request, error: Exception) -> Response:
    """422 for query, path and header parameters; bodies are checked in `bodies`."""
    assert isinstance(error, RequestValidationError)
    errors = [
        {
            "pointer": ".".join(str(part) for part in one["loc"][1:]),
            "in": str(one["loc"][0]),
            "code": one["type"],
            "detail": one["msg"],
        }
        for one in error.errors()
    ]
    detail = f"{errors[0]['pointer']}: {errors[0]['detail']}"
    return await _problem(request, Problem("invalid-parameters", detail, errors=errors))


async def _http(request: Request, error: Exception) -> Response:
    """What the router raises: an unknown path, a wrong method."""
    assert isinstance(error, HTTPException)
    if error.status_code == 405:
        methods = sorted(_methods(request))
        detail = f"Expected {' or '.join(methods)}."
        return await _problem(
            request, Problem("method-not-allowed", detail, headers={"allow": ", ".join(methods)})
        )
    if error.status_code == 404:
        return await _problem(request, Problem("not-found", "Nothing is at this path."))
    slug = "malformed-body" if error.status_code == 400 else "internal"
    return await _problem(request, Problem(slug, "The request cannot be read."))


def _methods(request: Request) -> set[str]:
    """All methods of the routes at this path."""
    scope = {**request.scope, "method": "?"}
    routes = [*request.app.routes, *(route for part in PARTS for route in part.router.routes)]
    found = {
        method
        for route in routes
        if isinstance(route, Route | APIRoute) and route.matches(scope)[0] is not Match.NONE
        for method in route.methods or ()
    }
    return found or {"GET", "HEAD"}  # files of the page
