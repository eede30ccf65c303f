"""Seconds and memory of the UV raster, beside the figures it is held to.

python benchmarks/bench_raster.py [MESH] [--size 2048 4096]
MESH is the scanned head where it is at hand, else our own asset.
"""

import argparse
import resource
import time
from pathlib import Path

from texsss.io.meshes import read_mesh
from texsss.surface.atlas import make_atlas
from texsss.surface.raster import rasterise

HEAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "head" / "LeePerrySmith.obj"
OWN = Path(__file__).resolve().parents[1] / "assets" / "axolotl" / "axolotl.obj"
LIMITS = {2048: "≤ 1 s", 4096: "peak ≤ 6 GB"}


def main() -> None:
    """Prints the least of five runs for every size, and the peak of the whole process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", type=Path, nargs="?", default=HEAD if HEAD.is_file() else OWN)
    parser.add_argument("--size", type=int, nargs="+", default=[1024, 2048, 4096])
    options = parser.parse_args()
    mesh, _ = read_mesh(options.mesh)
    atlas = make_atlas(mesh, size=options.size[0])
    print(f"{options.mesh.name}: {len(mesh.faces):,} faces, atlas from {atlas.origin}")
    for size in options.size:
        seconds = []
        for _ in range(5):
            start = time.perf_counter()
            maps = rasterise(mesh, atlas.uv, (size, size))
            seconds.append(time.perf_counter() - start)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(
            f"{size}²: {min(seconds):.2f} s, {maps.covered_count:,} covered + "
            f"{len(maps) - maps.covered_count:,} gutter texels, "
            f"process peak {peak:.2f} GB   ({LIMITS.get(size, 'no limit')})"
        )


if __name__ == "__main__":
    main()
