"""Small meshes as OBJ files."""

import math

CUBE_OBJ = """
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 1 5 8 4
"""

SQUARE_OBJ = """
v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4
"""


def torus_obj(
    around: int = 24, through: int = 12, radius: float = 60, tube: float = 20, digits: int = 5
) -> bytes:
    """A torus in the xz plane [mm] whose texture coordinates fill the square once."""
    lines = []
    for i in range(around):
        for j in range(through):
            a, b = 2 * math.pi * i / around, 2 * math.pi * j / through
            r = radius + tube * math.cos(b)
            point = r * math.sin(a), tube * math.sin(b), r * math.cos(a)
            lines.append("v " + " ".join(f"{x:.{digits}f}" for x in point))
    for i in range(around + 1):
        lines += [f"vt {i / around:.{digits}f} {j / through:.{digits}f}" for j in range(through + 1)]
    for i in range(around):
        for j in range(through):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            place = [(m % around) * through + n % through + 1 for m, n in corners]
            texture = [m * (through + 1) + n + 1 for m, n in corners]
            lines.append("f " + " ".join(f"{p}/{t}" for p, t in zip(place, texture, strict=True)))
    return "\n".join(lines).encode()
