"""The layout holds: who may import whom, how long a file may be, what the public face is."""

import ast
import tomllib
from pathlib import Path

import pytest
import torch

import texsss
from texsss.numerics.sampling import bilinear

ROOT = Path(__file__).resolve().parents[1] / "texsss"

BASE = {"errors", "types", "numerics"}
ROOMS = BASE | {"surface", "media", "light", "profiles", "transport", "view", "io"}
MAY_IMPORT = {
    "errors": set(),
    "types": {"errors"},
    "numerics": BASE,
    "surface": BASE | {"surface"},
    "media": BASE | {"media"},
    "io": BASE | {"surface", "io"},
    "light": BASE | {"surface", "media", "light"},
    "profiles": BASE | {"media", "profiles"},
    "transport": BASE | {"surface", "media", "light", "profiles", "transport"},
    "view": BASE | {"surface", "media", "light", "view"},
    "ahead": {"numerics", "transport"},
    "shelf": {"errors", "types"},
    "cache": {"errors", "types", "shelf"},
    "specs": {"errors", "types"},
    "lamps": {"specs"},
    "material": {"specs"},
    "methods": {"specs"},
    "shots": {"specs"},
    "complaints": {"specs", "lamps"},
    "scene": {"errors", "types", "specs", "lamps", "material", "shots", "methods", "complaints"},
    "gallery": {"errors", "scene"},
    "resolve": ROOMS | {"scene", "specs", "material"},
    "placing": ROOMS | {"scene", "lamps", "shots", "resolve"},
    "look": ROOMS | {"material", "methods", "resolve"},
    "report": ROOMS | {"scene"},
    "reading": {"types"},
    "result": ROOMS | {"scene", "report", "reading"},
    "estimate": ROOMS | {"scene", "pipeline", "placing"},
    "stages": {"errors", "types", "scene", "cache"},
    "ground": ROOMS | {"scene", "resolve", "cache", "stages"},
    "matter": ROOMS | {"resolve", "cache", "ground", "look"},
    "lighting": ROOMS | {"placing", "cache", "look", "matter"},
    "hierarchy": ROOMS | {"cache", "look", "lighting"},
    "beneath": ROOMS | {"cache", "hierarchy", "look", "material"},
    "diffusing": ROOMS | {"cache", "beneath"},
    "pipeline": ROOMS | {"placing", "look", "cache", "diffusing", "result", "report"},
    "intermediates": ROOMS | {"specs", "pipeline", "placing", "methods"},
    "showing": ROOMS | {"lamps", "pipeline", "placing", "cache"},
    "curve": ROOMS | {"pipeline", "resolve"},
    "inspection": ROOMS | {"pipeline", "curve"},
    "baker": {
        *("errors", "types", "scene", "cache", "shelf", "resolve", "result", "diffusing", "pipeline", "view"),
        *("curve", "estimate", "inspection", "intermediates", "io", "showing", "surface", "profiles"),
        "transport",
    },
    "compare": {"errors", "types", "methods", "scene", "baker", "result", "io"},
    "depth_maps": ROOMS,
    "plot": set(),
    "shorthand": {"errors"},
    "options": {"errors", "scene", "shorthand", "io"},
    "openmp": set(),
    "terminal": {"errors"},
    "__main__": {"cli"},
    "cli": {
        "terminal",
        *("openmp", "baker", "compare", "result", "scene", "options", "plot", "types", "errors", "io"),
        *("ahead", "cache", "gallery", "shelf"),
    },
    "__init__": set(),
}


SERVER = ROOT.parent / "server"
SERVER_MAY_IMPORT = {
    *("ahead", "complaints"),
    *("baker", "scene", "specs", "shots", "types", "errors", "result", "io", "cache", "curve"),
    *("gallery", "reading"),
}


def modules():
    return sorted(ROOT.rglob("*.py"))


def server_modules():
    return sorted(SERVER.rglob("*.py"))


def imports(path: Path) -> set[str]:
    """Rooms of texsss that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write the whole name"
            names = [node.module, *(f"{node.module}.{a.name}" for a in node.names if node.module == "texsss")]
        elif isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        found |= {name.split(".")[1] for name in names if name and name.startswith("texsss.")}
    return found


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(ROOT)))
def test_dependencies_run_one_way(path):
    relative = path.relative_to(ROOT)
    room = relative.parts[0].removesuffix(".py")
    assert room in MAY_IMPORT, f"{room} is not in the table: give it a place"
    assert imports(path) <= MAY_IMPORT[room], f"{relative} may import {sorted(MAY_IMPORT[room])}"


@pytest.mark.parametrize("path", server_modules(), ids=lambda p: str(p.relative_to(SERVER)))
def test_server_knows_the_library_by_its_face(path):
    assert imports(path) <= SERVER_MAY_IMPORT, f"the server may import {sorted(SERVER_MAY_IMPORT)}"


@pytest.mark.parametrize("path", modules() + server_modules(), ids=lambda p: str(p.relative_to(ROOT.parent)))
def test_files_hold_one_concept(path):
    lines = len(path.read_text().splitlines())
    assert lines <= 350, f"{lines} lines: split the room"


def test_rooms_are_empty_at_the_door():
    for init in ROOT.glob("*/__init__.py"):
        tree = ast.parse(init.read_text())
        assert all(isinstance(n, ast.ImportFrom | ast.Expr | ast.Assign) for n in tree.body), init


def test_public_names_exist():
    for name in texsss.__all__:
        assert getattr(texsss, name) is not None


def test_shape_hook_is_live():
    """A wrong shape must fail: else every annotation in the project is decoration."""
    import jaxtyping

    with pytest.raises(jaxtyping.TypeCheckError):
        bilinear(torch.zeros(4, 4, 3), torch.zeros(5, 3))


def test_every_folder_of_code_is_packaged():
    """Editable installs find folders that a wheel would lack."""
    stated = tomllib.loads((ROOT.parent / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    places = {"texsss": ROOT, "texsss_server": SERVER, "texsss_assets": ROOT.parent / "assets"}
    folders = {
        ".".join((name, *path.parent.relative_to(place).parts))
        for name, place in places.items()
        for path in place.rglob("__init__.py")
    }
    assert folders == set(stated)
