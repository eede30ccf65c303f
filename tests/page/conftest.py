"""A real browser in front of a real server. Where one of them is missing, that is said loudly."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from obj_files import torus_obj
from paging import SETTLED, address
from serving import OBJ, Running, end, launch, until_ready

STATIC = Path(__file__).parents[2] / "server" / "static"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGS = (
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
MISSING = (
    "Chromium is missing (Debian: apt-get install chromium)"
    if CHROMIUM is None
    else None
    if (STATIC / "index.html").is_file()
    else "server/static is empty (run make page)"
)
TIMEOUT_MS = 30_000


def pytest_collection_modifyitems(items):
    here = Path(__file__).parent
    for item in items:
        if MISSING and here in item.path.parents:
            if os.environ.get("CI") == "true":
                pytest.exit(f"the page must be tested here, but {MISSING}", returncode=3)
            item.add_marker(pytest.mark.skip(reason=f"THE PAGE IS NOT TESTED: {MISSING}"))


def pytest_terminal_summary(terminalreporter):
    if MISSING:
        terminalreporter.write_sep("!", f"THE PAGE WAS NOT TESTED: {MISSING}", red=True, bold=True)


@pytest.fixture(scope="session")
def page_server(tmp_path_factory) -> Iterator[Running]:
    running = launch(tmp_path_factory.mktemp("page"), "page")
    try:
        yield until_ready(running)
    finally:
        end(running)


@pytest.fixture(scope="session")
def ring(page_server) -> dict:
    """A scene that bakes in a moment: a torus of skin, lit from the side, marched for no view."""
    with page_server.client(**OBJ) as client:
        asset = client.post("/v1/assets", params={"name": "ring.obj"}, content=torus_obj()).json()["asset"]
    return ring_of(asset)


def ring_of(asset: str) -> dict:
    lamp = {"type": "point", "position_mm": [300, 150, 250], "intensity_w_per_sr": [0.8, 0.8, 0.8]}
    return {
        "mesh": {"source": {"asset": asset}, "unit_mm": 1.0},
        "maps": {},
        "atlas": {"size": 64},
        "material": {"layers": [{"medium": "skin1"}], "surface": {"roughness": 0.35}},
        "lights": [lamp],
        "methods": {"single_scattering": "none"},
    }


@pytest.fixture(scope="session")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=CHROMIUM, chromium_sandbox=False, args=list(ARGS))
        yield made
        made.close()


# a coarse screen: without a graphics card every pixel costs
USUAL = {"viewport": {"width": 860, "height": 640}, "device_scale_factor": 0.5, "reduced_motion": "reduce"}


@pytest.fixture(scope="session")
def window(browser, page_server):
    """The window of most visits, which keeps scripts that were compiled; nothing else."""
    context = browser.new_context(base_url=page_server.url, **USUAL)
    context.add_init_script("localStorage.clear()")
    context.set_default_timeout(TIMEOUT_MS)
    yield context
    context.close()


@pytest.fixture
def visit(browser, window, page_server, ring) -> Iterator[Callable]:
    """Opens the page on the ring, parts of its scene replaced; at the end no error may have been logged."""
    opened, said = [], []

    def hear(message):
        if message.type == "error" and "GPU stall due to ReadPixels" not in message.text:
            said.append(message.text)

    def open_page(scene: dict | None = None, *, path: str | None = None, server=page_server, **options):
        if options or server is not page_server:
            context = browser.new_context(base_url=server.url, **(USUAL | options))
            context.set_default_timeout(TIMEOUT_MS)
            opened.append(context)
            page = context.new_page()
        else:
            page = window.new_page()
            opened.append(page)
        page.on("console", hear)
        page.on("pageerror", lambda error: said.append(str(error)))
        page.said = said
        page.goto(path or address(ring | (scene or {})))
        page.wait_for_selector(SETTLED)
        return page

    yield open_page
    for one in opened:
        one.close()
    assert said == []
