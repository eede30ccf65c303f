"""Meshes from files: OBJ, PLY, STL and glTF as one `Mesh` in millimetres, y up."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from texsss.errors import AssetError
from texsss.io._gltf import read_glb, read_gltf
from texsss.io._obj import read_obj
from texsss.io._ply import read_ply
from texsss.io._raw import Fault, RawMesh
from texsss.io._stl import read_stl
from texsss.io.probe import MeshFormat, mesh_format
from texsss.surface.mesh import Mesh
from texsss.types import Float, Int

Up = Literal["y", "z", "x", "-y", "-z", "-x"]
VDirection = Literal["auto", "up", "down"]

READERS: dict[MeshFormat, Callable[[bytes], RawMesh]] = {
    "obj": read_obj, "ply": read_ply, "stl": read_stl, "glb": read_glb, "gltf": read_gltf,
}  # fmt: skip
MAX_BYTES = 2 << 30
LARGEST_MM, SMALLEST_MM = 1e9, 1e-12
THINNEST = 1e-7  # height over longest side, below which a triangle has no normal in float32
SAME = 2.0**-24  # of the longest side: vertices this close coincide
FAR = 1e3  # centres farther from the origin than so many diagonals lose digits in float32

# rows of the rotation that takes the axis named to +y
UPRIGHT: dict[str, list[list[float]]] = {
    "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}


@dataclass(frozen=True)
class MeshNotes:
    """What was found in a mesh file, and what was assumed.

    `unit_mm`: millimetres per unit of the file; `unit_assumed`: nobody stated it. `size_mm`: extent
    along x, y, z. `faces_dropped`: triangles without area. `uv`: whether the file has texture coordinates.
    `vertices_in_file`, `shift_mm`: how many it has before they merge, and by how much they were moved once
    upright and in millimetres. `messages`: all of it as sentences for the user.
    """

    file_format: MeshFormat
    unit_mm: float
    unit_assumed: bool
    size_mm: tuple[float, float, float]
    faces: int
    vertices: int
    faces_dropped: int
    uv: Literal["complete", "none"]
    messages: tuple[str, ...]
    vertices_in_file: int
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def height_mm(self) -> float:
        """Size along y [mm]."""
        return self.size_mm[1]


def read_mesh(
    source: Path | str | bytes,
    *,
    unit_mm: float | int | None = None,
    up: Up = "y",
    v: VDirection = "auto",
    file_type: str | None = None,
    name: str | None = None,
) -> tuple[Mesh, MeshNotes]:
    """A mesh file as one mesh [mm], y up, and what was assumed in reading it.

    `source`: a path, or a file's bytes, whose kind is told from their content (`file_type` is a hint).
    `unit_mm`: millimetres per unit of the file. If None: metres for glTF, as it prescribes; millimetres
    for STL, as printers have it; else by the longest side: metres below 3 units, centimetres below 300,
    else millimetres. `up`: the file's axis that points up. Vertices merge where float32 cannot part them;
    texture coordinates stay per corner and come out v down. `v`: which way the file's own v runs; `auto` as
    its format prescribes, down in glTF and up elsewhere, but up in glTF without maps from early Blender
    exporters, which left it so. Faces keep the file's order;
    triangles without area are dropped. Other files that the mesh refers to are never opened.
    Raises AssetError: when the file is missing, unreadable, no mesh, or no surface; when vertices or texture
    coordinates are not finite, or only some faces have the latter; when the size is not sensible.
    """
    data, name = bytes_of(source, name)
    try:
        unit = None if unit_mm is None else float(unit_mm)
        if unit is not None and not (np.isfinite(unit) and unit > 0):
            raise Fault(
                f"expected a unit above 0 mm, got {unit_mm}", "pass millimetres per unit, 1000 for metres"
            )
        if up not in UPRIGHT:
            raise Fault(
                f"expected up as one of {', '.join(UPRIGHT)}, got {up!r}", "name the axis that points up"
            )
        kind, raw = _raw(data, file_type, name)
        if raw.uv is not None and v not in ("auto", raw.v_runs):
            raw.uv[..., 1] = 1 - raw.uv[..., 1]
        return _finished(raw, kind, unit, up, Path(name).stem)
    except Fault as fault:
        raise fault.named(name) from None


def read_positions(
    source: Path | str | bytes,
    *,
    unit_mm: float | int,
    up: Up = "y",
    file_type: str | None = None,
    name: str | None = None,
) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Positions of all vertices of a mesh file [mm], y up, in its own order, and its triangles.

    Nothing merges and nothing is dropped, so that poses of one mesh keep their numbering. The rest as
    `read_mesh`. Raises AssetError: when the file is missing, unreadable or no mesh, or vertices that it uses
    are not finite.
    """
    data, name = bytes_of(source, name)
    try:
        _, raw = _raw(data, file_type, name)
        _check_finite(raw.vertices[_compact(len(raw.vertices), raw.faces)[0]], None)
        return _upright(raw.vertices, float(unit_mm), up), raw.faces
    except Fault as fault:
        raise fault.named(name) from None


def _raw(data: bytes, file_type: str | None, name: str) -> tuple[MeshFormat, RawMesh]:
    kind = mesh_format(data, file_type or Path(name).suffix)
    return kind, READERS[kind](data)


def _upright(points: np.ndarray, unit_mm: float, up: Up) -> np.ndarray:
    return points * unit_mm @ np.array(UPRIGHT[up]).T


def bytes_of(source: Path | str | bytes, name: str | None = None) -> tuple[bytes, str]:
    """Content and name of a mesh file. Raises AssetError: when it is missing, too large or unreadable."""
    if isinstance(source, bytes):
        return source, name or "mesh"
    path = Path(source)
    name = name or path.name
    try:
        if not path.is_file():
            raise AssetError(f"{path}: expected a mesh file, found {_what_is(path)}; check the path.")
        if path.stat().st_size > MAX_BYTES:
            raise Fault("expected at most 2 GiB", "decimate the mesh").named(name)
        return path.read_bytes(), name
    except (OSError, ValueError) as error:
        if isinstance(error, AssetError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        raise AssetError(f"{path}: the file cannot be read ({reason}); check its permissions.") from None


def _what_is(path: Path) -> str:
    return "a folder" if path.is_dir() else "none"


def _finished(
    raw: RawMesh, kind: MeshFormat, unit_mm: float | None, up: Up, name: str
) -> tuple[Mesh, MeshNotes]:
    notes = list(dict.fromkeys(raw.notes))
    used, faces = _compact(len(raw.vertices), raw.faces)
    points = raw.vertices[used]
    _check_finite(points, raw.uv)
    extent = np.ptp(points, axis=0)
    longest = float(extent.max())
    if not longest > 0:
        raise Fault("all vertices lie in one point", "check the export and its scale")
    assumed = unit_mm is None
    if unit_mm is None:
        unit_mm = _assumed_unit(kind, longest)
    if not SMALLEST_MM <= longest * unit_mm <= LARGEST_MM:
        raise Fault(
            f"expected an object of {SMALLEST_MM:g} to {LARGEST_MM:g} mm, got {longest * unit_mm:.3g} mm "
            f"at {unit_mm:g} mm per unit",
            "state the unit, or scale the mesh",
        )
    points = _upright(points, unit_mm, up)
    centre, shift = (points.max(0) + points.min(0)) / 2, np.zeros(3)
    if np.linalg.norm(centre) > FAR * longest * unit_mm:
        shift, points = -centre, points - centre
        notes.append(f"it lay {np.linalg.norm(centre):.3g} mm from the origin and was moved there")
    kept, faces, uv, dropped = _merged(points, faces, raw.uv)
    vertices = points[kept].astype(np.float32)
    if dropped:
        notes.append(f"{dropped:,} of {len(raw.faces):,} triangles have no area and were dropped")
    size = np.ptp(vertices, axis=0)
    if assumed:
        notes.insert(
            0,
            f"no unit was given: one unit of this {kind.upper()} is taken as {unit_mm:g} mm, "
            f"which makes the object {size[1]:.4g} mm tall",
        )
    origin = torch.from_numpy(used[kept])
    mesh = Mesh(torch.from_numpy(vertices), torch.from_numpy(faces), uv, name, origin)
    notes_of_file = MeshNotes(
        file_format=kind,
        unit_mm=unit_mm,
        unit_assumed=assumed,
        size_mm=(float(size[0]), float(size[1]), float(size[2])),
        faces=len(faces),
        vertices=len(vertices),
        faces_dropped=dropped,
        uv="none" if uv is None else "complete",
        messages=tuple(notes),
        vertices_in_file=len(raw.vertices),
        shift_mm=(float(shift[0]), float(shift[1]), float(shift[2])),
    )
    return mesh, notes_of_file


def _assumed_unit(kind: MeshFormat, longest: float) -> float:
    if kind in ("glb", "gltf"):
        return 1000.0
    if kind == "stl":
        return 1.0
    return 1000.0 if longest < 3 else 10.0 if longest < 300 else 1.0


def _compact(vertices: int, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which vertices faces use, and the faces in terms of those alone."""
    used = np.zeros(vertices, dtype=bool)
    used[faces] = True
    return np.flatnonzero(used), (np.cumsum(used) - 1)[faces]


def _check_finite(points: np.ndarray, uv: np.ndarray | None) -> None:
    wrong = int((~np.isfinite(points)).any(-1).sum())
    if wrong:
        raise Fault(f"expected finite vertices, got {wrong:,} with NaN or infinity", "repair the mesh")
    if uv is None:
        return
    wrong = int((~np.isfinite(uv)).any((-1, -2)).sum())
    if wrong:
        raise Fault(
            f"expected finite texture coordinates, got NaN or infinity on {wrong:,} faces", "unwrap it again"
        )
    if np.abs(uv).max() > 1e6:
        raise Fault(
            f"texture coordinates reach {np.abs(uv).max():.3g}, where tiles have no digits left",
            "unwrap the mesh again",
        )


def _coinciding(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which vertices stand for all, in the file's order, and which of those stands for each.

    Vertices coincide in cells of `SAME` of the longest side, which float32 cannot tell apart: exporters that
    compute both sides of a seam get 0 on one and 1e-16 on the other. A second grid, off by half a cell,
    catches those that the first one parts.
    """
    cell = SAME * float(np.ptp(points, axis=0).max())
    low = points.min(0)
    kept, number = np.arange(len(points)), np.arange(len(points))
    for shift in (0.5, 0.0):
        cells = np.floor((points[kept] - low) / cell + shift).astype(np.int32)
        packed = np.ascontiguousarray(cells).view(np.dtype((np.void, 12)))[:, 0]
        _, first, where = np.unique(packed, return_index=True, return_inverse=True)
        order = np.argsort(first)
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        kept, number = kept[first[order]], rank[where.reshape(-1)][number]
    return kept, number


def _merged(
    points: np.ndarray, faces: np.ndarray, uv: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, torch.Tensor | None, int]:
    """Which vertices stay, faces of these, and uv; coinciding vertices made one and flat faces dropped."""
    kept, number = _coinciding(points)
    faces = number[faces]
    corners = points[kept].astype(np.float32).astype(np.float64)[faces]
    edges = np.roll(corners, -1, 1) - corners
    doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    sound = doubled > THINNEST * (edges**2).sum(-1).max(-1)
    if not sound.any():
        raise Fault("no triangle has any area", "give a mesh with a surface")
    used, faces = _compact(len(kept), faces[sound])
    texture = None if uv is None else torch.from_numpy(uv[sound].astype(np.float32))
    return kept[used], faces, texture, int((~sound).sum())
