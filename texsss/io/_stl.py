"""STL: the header checked against the bytes present, then read directly."""

import re
import struct

import numpy as np

from texsss.io._raw import Fault, RawMesh, check_counts

CUT = "it is cut short or damaged, copy it again"
VERTEX = re.compile(rb"vertex" + rb"\s+([-+.\w]+)" * 3, re.IGNORECASE)
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes) -> RawMesh:
    """The triangles of a binary or text STL; it has no texture coordinates. Raises Fault: when cut short."""
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else 0
    # programs write "solid" into the header of binary files too, and more behind the last triangle
    fits = 84 + 50 * count == len(data) or (84 + 50 * count < len(data) and VERTEX.search(data) is None)
    if len(data) >= 84 and (fits or data.lstrip()[:5].lower() != b"solid"):
        if 84 + 50 * count > len(data):
            raise Fault(
                f"the header claims {count:,} triangles, the file holds {(len(data) - 84) // 50:,}", CUT
            )
        check_counts(3 * count, count)
        corners = np.frombuffer(data, STL_TRIANGLE, count, 84)["corners"].reshape(-1, 3)
    else:
        rows = VERTEX.findall(data)
        try:
            corners = np.array([[float(word) for word in row] for row in rows]).reshape(-1, 3)
        except ValueError:
            raise Fault("a vertex is not made of three numbers") from None
        if len(corners) % 3:
            raise Fault("its last triangle is not complete", CUT)
        check_counts(len(corners), len(corners) // 3)
    if not len(corners):
        raise Fault("expected triangles, found none", "give a mesh with a surface")
    return RawMesh(corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3), None)
