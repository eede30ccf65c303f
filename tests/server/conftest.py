"""Two servers for all tests of the service."""

from collections.abc import Iterator

import httpx
import pytest
from obj_files import torus_obj
from serving import KEY, OBJ, STRICT, Running, end, launch, quick, until_ready


@pytest.fixture(scope="session")
def _both(tmp_path_factory) -> Iterator[tuple[Running, Running]]:
    """Two servers that start at the same time, since importing takes seconds."""
    folder = tmp_path_factory.mktemp("servers")
    running = [launch(folder, "open"), launch(folder, "strict", **STRICT)]
    try:
        yield until_ready(running[0]), until_ready(running[1])
    finally:
        for one in running:
            end(one)


@pytest.fixture(scope="session")
def server(_both) -> Running:
    """A server with usual limits."""
    return _both[0]


@pytest.fixture(scope="session")
def strict(_both) -> Running:
    """A server with tight limits and a key; the last test of test_limits.py stops it."""
    return _both[1]


@pytest.fixture
def client(server) -> Iterator[httpx.Client]:
    with server.client() as client:
        yield client


@pytest.fixture
def tight(strict) -> Iterator[httpx.Client]:
    with strict.client(authorization=f"Bearer {KEY}") as client:
        yield client


@pytest.fixture(scope="session")
def torus() -> bytes:
    return torus_obj()


@pytest.fixture(scope="session")
def small(server, torus) -> dict:
    """A scene that renders in milliseconds: an uploaded torus."""
    asset = httpx.post(
        f"{server.url}/v1/assets", params={"name": "torus.obj"}, content=torus, headers=OBJ, timeout=60
    )
    assert asset.status_code in (200, 201), asset.text
    return quick({"asset": asset.json()["asset"]})
