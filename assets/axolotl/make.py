"""Builds axolotl.obj and its textures. Run: ``python make.py`` in this folder.

Needs numpy, scipy, scikit-image, fast-simplification and pillow.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from apart import drawn_apart
from bake import coverage, rasterise, save_maps
from fields import Array
from mesh import Faces, polygonise, reduce
from pack import pack
from shape import Axolotl
from unwrap import unwrap


def write_obj(path: Path, p: Array, faces: Faces, uv: Array, uv_faces: Faces) -> None:
    """Positions in mm, texture coordinates with v up; normals are left to the reader."""
    lines = [
        "# axolotl, millimetres, y up, head towards +z",
        "mtllib axolotl.mtl",
        "usemtl axolotl",
    ]
    lines += [f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in p]
    lines += [f"vt {u:.5f} {v:.5f}" for u, v in uv]
    for f, t in zip((faces + 1).tolist(), (uv_faces + 1).tolist(), strict=True):
        lines.append("f " + " ".join(f"{a}/{b}" for a, b in zip(f, t, strict=True)))
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text("newmtl axolotl\nKd 1 1 1\nmap_Kd albedo.png\n")


def main() -> None:
    """Model, unwrap, paint, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument("--cell", type=float, default=0.5, help="polygonising grid, mm")
    parser.add_argument("--faces", type=int, default=40000)
    parser.add_argument("--size", type=int, default=1024, help="texture size")
    args = parser.parse_args()
    animal = Axolotl()
    p, faces = polygonise(animal, args.cell)
    p, faces = reduce(animal, p, faces, args.faces)
    print(f"{len(p)} vertices, {len(faces)} faces")
    flat, uv_faces, label = unwrap(animal, p, faces)
    # Padding is set at 1024, whatever the size of the textures.
    uv = drawn_apart(pack(flat, uv_faces, label, 6), uv_faces)
    args.out.mkdir(parents=True, exist_ok=True)
    write_obj(args.out / "axolotl.obj", p, faces, uv, uv_faces)
    texels = rasterise(uv, uv_faces, args.size)
    covered, overlap = coverage(uv, uv_faces, 1024)
    print(f"coverage {covered:.1%}, overlap {overlap} texels")
    save_maps(args.out, animal, p, faces, texels)


if __name__ == "__main__":
    main()
