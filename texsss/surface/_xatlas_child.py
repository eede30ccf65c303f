"""Run as a script in a process of its own: unwrap the arrays in one file, write another.

It imports nothing of texsss, so that the child starts in a tenth of a second.
"""

import sys

import numpy as np


def unwrap(vertices: np.ndarray, faces: np.ndarray, size: int, padding: int) -> np.ndarray:
    """uv (F, 3, 2) in the unit square, v down, charts `padding` texels apart at `size`."""
    import xatlas

    # xatlas packs near the resolution it is asked for, usually above: ask for more padding, check, try again
    asked = int(np.ceil(1.3 * padding))
    while True:
        atlas = xatlas.Atlas()
        atlas.add_mesh(vertices, faces)
        options = xatlas.PackOptions()
        options.padding, options.resolution = asked, size
        atlas.generate(xatlas.ChartOptions(), options)
        side = max(atlas.width, atlas.height)
        if asked * size >= padding * side or asked > size:
            break
        asked = int(np.ceil(padding * side / size * 1.1))
    _, index, uv = atlas[0]
    # a square keeps texels square
    return uv[index] * (np.array([atlas.width, atlas.height]) / side)


def main(source: str, target: str) -> None:
    """Reads the arrays, unwraps, writes."""
    given = np.load(source)
    uv = unwrap(given["vertices"], given["faces"], int(given["size"]), int(given["padding"]))
    np.save(target, uv.astype(np.float32))


if __name__ == "__main__":
    main(*sys.argv[1:3])
