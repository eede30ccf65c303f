"""Wavefront OBJ in all the ways that exporters write it, read the same."""

import codecs

import numpy as np
import pytest

from texsss.io._obj import read_obj
from texsss.io._raw import Fault

HEAD = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvn 0 0 1\n"
FACES = [[0, 1, 2], [2, 1, 3]]
UV = [[[0, 1], [1, 1], [0, 0]], [[0, 0], [1, 1], [1, 0]]]


@pytest.mark.parametrize(
    "faces",
    [
        "f 1/1 2/2 3/3\nf 3/3 2/2 4/4",
        "f 1/1/1 2/2/1 3/3/1\nf 3/3/1 2/2/1 4/4/1",
        "f 1/1/1 2/2 3/3/1\nf 3/3 2/2/1 4/4",
        "f -4/-4 -3/-3 -2/-2\nf -2/-2 -3/-3 -1/-1",
        "f 1/-4 2/2 -2/3\nf 3/3/-1 2/2/1 4/4/1",
        "f\t1/1  2/2\t3/3 # a comment\n  f 3/3 2/2 \\\n4/4",
        "f 1/1 2/2 3/3\r\nf 3/3 2/2 4/4\r\n",
        "# saved from C:\\meshes\\\nf 1/1 2/2 3/3\nf 3/3 2/2 4/4",
        "g a\ns 1\nusemtl skin\nf 1/1 2/2 3/3\no b\nl 1 2\nf 3/3 2/2 4/4",
    ],
)
def test_all_ways_to_write_corners_are_one(faces):
    read = read_obj(codecs.BOM_UTF8 + (HEAD + faces).encode())
    assert read.uv is not None
    np.testing.assert_array_equal(read.faces, FACES)
    np.testing.assert_array_equal(read.uv, UV)


@pytest.mark.parametrize(
    "faces", ["f 1 2 3\nf 3 2 4", "f 1//1 2//1 3//1\nf 3//1 2//1 4//1", "f 1/ 2/ 3/\nf 3/ 2/ 4/"]
)
def test_corners_without_texture_coordinates(faces):
    read = read_obj((HEAD + faces).encode())
    np.testing.assert_array_equal(read.faces, FACES)
    assert read.uv is None


def test_numbers_beyond_the_ones_needed_are_left_out():
    text = "v 0 0 0 1 .5 .5\nv 1 0 0\nv 0 1 0 1\nvt .25\nvt .5 .75 0\nf 1/1 2/1 3/2\n"
    read = read_obj(text.encode())
    np.testing.assert_array_equal(read.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(read.uv, [[[0.25, 1], [0.25, 1], [0.5, 0.25]]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("v 1 2\nf 1 1 1", "line 1 .*expected 3 numbers, got 2"),
        (HEAD + "v 1 2 x\n", "line 10 .*'x'"),
        (HEAD + "f 1 \\\n2 \\\n3\nf 1 \\\n2\n", "line 13 .*3 corners or more, got 2"),
        (HEAD + "v\nf 1 2 3", "line 10 .*got 0"),
        (HEAD + "f 1 2", "line 10 .*3 corners or more, got 2"),
        (HEAD + "f 1 2 3\n\nf 1 0 3", "line 12 .*start at 1"),
        (HEAD + "f 1/ /1 2/3/4", "line 10 .*''"),
        (HEAD + "f 1 2 1e0", "line 10 .*'1e0'"),
        (HEAD + "f -1 -2 -5", "line 10 .*goes 1 before the first of 4"),
        (HEAD + "f 1/-1 2/-1 3/-5", "line 10 .*goes 1 before the first of 4"),
        (HEAD + "f 1 2 99999999999999999999", "line 10 .*beyond any mesh"),
        (HEAD + "f 1 2 5", "vertex 5 of 4"),
        (HEAD + "f 1/1 2/2 3/5", "texture coordinate 5 of 4"),
        (HEAD + "f 1/1 2/2 3/3\nf 3 2 4", "1 of 2 faces have no"),
        (HEAD + "f 1/1 2/2 3\nf 3/3 2/2 4", "2 of 2 faces have no"),
        ("v 0 0 0", "1 vertices but no faces"),
        ("", "no vertices and no faces"),
    ],
)
def test_what_is_not_understood_is_told_by_line(text, said):
    with pytest.raises(Fault, match=said):
        read_obj(text.encode())
