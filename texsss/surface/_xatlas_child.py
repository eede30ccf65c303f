"""Run as a script in a process of its own: unwrap the arrays in one file, write another.

It imports nothing of texsss, so that the child starts in a tenth of a second.
"""

import sys

import numpy as np

PIECE = 1200  # faces that xatlas gets at once: its charts grow in time that rises faster than their size
CLOSE = 0.97  # share of the square's edge that a packing may leave off
TRIES = 8  # packings, at most, before one that fits is taken
MORE = 24  # and before none is
NO_ROOM, NO_MEMORY = 3, 4  # codes that it ends with


class NoRoom(Exception):
    """No packing fits into the square."""


def pieces(place: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Sets of at most PIECE faces that lie close together, by dividing; those of one place stay together."""
    count = -(-len(faces) // PIECE)
    if count <= 1:
        return [faces]
    here = place[faces]
    axis = int(np.argmax(here.max(0) - here.min(0)))
    order = np.argsort(here[:, axis], kind="stable")
    line = here[order, axis]
    cut = int(np.searchsorted(line, line[len(line) * (count // 2) // count]))
    if cut == 0:
        cut = int(np.searchsorted(line, line[0], side="right"))
    if cut == len(line):
        return [faces]
    return pieces(place, faces[order[:cut]]) + pieces(place, faces[order[cut:]])


def unwrap(
    vertices: np.ndarray, faces: np.ndarray, place: np.ndarray, size: int, padding: int
) -> tuple[np.ndarray, int]:
    """uv (F, 3, 2) in the unit square, v down, and how many texels its charts lie apart at `size`."""
    import xatlas

    parts = pieces(place, np.arange(len(faces)))
    atlas = xatlas.Atlas()
    for part in parts:
        used, index = np.unique(faces[part].reshape(-1), return_inverse=True)
        atlas.add_mesh(vertices[used], index.reshape(-1, 3).astype(np.uint32))
    options = xatlas.PackOptions()
    options.padding, options.resolution = 0, size
    atlas.generate(xatlas.ChartOptions(), options)
    edge = np.array([atlas.width, atlas.height])
    cut = [(index, (uv * edge).astype(np.float32)) for _, index, uv in (atlas[k] for k in range(len(parts)))]

    # a chart's own margin, twice that and two texels between charts; margins may take half of the square
    room = size / np.sqrt(2 * max(atlas.chart_count, 1))
    margin = int(np.clip((room - 3) / 2, 0, max(padding - 1, 0) // 2))
    packed = pack(cut, size, margin, 1.0 - (2 * margin + 3) / room)
    uv = np.empty((len(faces), 3, 2), np.float32)
    for part, (index, place_uv) in zip(parts, packed, strict=True):
        uv[part] = place_uv[index]
    return uv, 2 * margin + 2


def pack(cut: list, size: int, margin: int, filled: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Charts packed at the largest scale found at which they fit, `margin` texels around each.

    `cut`: indices and uv of each piece, in one unit; `filled`: about the share of the edge that charts get.
    """
    import xatlas

    options = xatlas.PackOptions()
    options.padding = margin
    span = max(float(uv.max()) for _, uv in cut if len(uv))
    scale, best, found = max(filled, 0.05) * size / span, 0.0, None
    for step in range(MORE):
        atlas = xatlas.Atlas()
        for index, uv in cut:
            atlas.add_uv_mesh(uv, index)
        options.texels_per_unit = scale
        atlas.generate(xatlas.ChartOptions(), options)
        edge = np.array([atlas.width, atlas.height])
        side = int(edge.max())
        if side <= size and scale > best:
            best = scale
            found = [(index, uv * (edge / size)) for _, index, uv in (atlas[k] for k in range(len(cut)))]
        if found is not None and (size * CLOSE <= side <= size or step >= TRIES):
            return found
        # short of the aim when too large: margins do not shrink along
        scale *= size / side * (0.99 if side <= size else 0.97)
    if found is None:
        raise NoRoom
    return found


def main(source: str, target: str) -> None:
    """Reads the arrays, unwraps, writes."""
    given = np.load(source)
    size, padding = int(given["size"]), int(given["padding"])
    uv, kept = unwrap(given["vertices"], given["faces"], given["place"], size, padding)
    np.savez(target, uv=uv, padding=kept)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:3])
    except NoRoom:
        sys.exit(NO_ROOM)
    except MemoryError:
        sys.exit(NO_MEMORY)
