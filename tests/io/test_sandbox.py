"""Hostile files in a limited child: each gives a mesh or one sentence, and the next one still works."""

import threading
import time
from pathlib import Path

import pytest
import torch

from texsss.errors import AssetError
from texsss.io.meshes import read_mesh
from texsss.io.sandbox import Sandbox

SQUARE = b"v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


@pytest.fixture(scope="module")
def box():
    with Sandbox() as sandbox:
        yield sandbox


def test_same_mesh_and_notes_as_without(box):
    mesh, notes = box.read_mesh(SQUARE, unit_mm=10, name="square.obj")
    plain, plain_notes = read_mesh(SQUARE, unit_mm=10, name="square.obj")
    assert notes == plain_notes and mesh.name == plain.name
    assert torch.equal(mesh.vertices, plain.vertices) and torch.equal(mesh.faces, plain.faces)
    assert torch.equal(mesh.source_uv, plain.source_uv)


def test_too_little_memory_or_time_is_one_sentence_and_the_next_file_works():
    many = b"".join(b"v %d %d 0\n" % (i, i * i % 97) for i in range(400_000)) + b"f 1 2 3\n"
    with Sandbox(memory_mb=30) as small:
        with pytest.raises(AssetError, match="needs more than 30 MB"):
            small.read_mesh(many, name="large.obj")
        assert small.read_mesh(SQUARE)[1].faces == 2
        small.memory_mb, small.timeout_s = 1500.0, 0.05
        with pytest.raises(AssetError, match=r"takes longer than 0\.05 s"):
            small.read_mesh(many, name="large.obj")


def test_a_server_that_ended_while_nothing_was_asked_is_started_again():
    with Sandbox() as sandbox:
        sandbox.read_mesh(SQUARE)
        assert sandbox._server is not None
        sandbox._server.kill()
        sandbox._server.wait()
        assert len(sandbox.read_mesh(SQUARE)[0].faces) == 2


def test_a_server_that_is_killed_is_noticed_at_once_and_leaves_no_child():
    many = b"".join(b"v %d %d 0\n" % (i, i * i % 97) for i in range(1_000_000)) + b"f 1 2 3\n"
    with Sandbox() as sandbox:
        sandbox.read_mesh(SQUARE)
        server = sandbox._server
        assert server is not None
        heard: list[str] = []

        def read() -> None:
            with pytest.raises(AssetError) as told:
                sandbox.read_mesh(many, name="large.obj")
            heard.append(str(told.value))

        reader = threading.Thread(target=read)
        reader.start()
        children: list[str] = []
        while not children:
            children = Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split()
        start = time.monotonic()
        server.kill()
        reader.join(20)
        assert time.monotonic() - start < 3 and "the process that reads it ended" in heard[0]
        time.sleep(0.2)
        left = Path(f"/proc/{children[0]}/stat")
        assert not left.exists() or left.read_text().rpartition(")")[2].split()[0] == "Z"
        assert sandbox.read_mesh(SQUARE)[1].faces == 2


def test_every_bad_mesh_is_a_mesh_or_one_sentence(bad_files, box):
    """All 158 files of the set but its textures, in well under three minutes."""
    start, meshes, sentences = time.monotonic(), 0, 0
    for path in sorted(bad_files.glob("*")):
        if path.is_dir():
            continue
        began = time.monotonic()
        try:
            mesh, notes = box.read_mesh(path)
            meshes += 1
            assert notes.faces == len(mesh.faces) > 0
            assert bool(torch.isfinite(mesh.corner_normals).all())
        except AssetError as error:
            sentences += 1
            assert str(error).startswith(path.name) and str(error).endswith(".") and "\n" not in str(error)
        assert time.monotonic() - began < 20
    assert (meshes, sentences) == (46, 86)
    assert time.monotonic() - start < 180
