"""What texsss answers to bad files: python -m benchmarks.hostile FOLDER [--write docs/files.md]

FOLDER holds bad meshes, and bad textures in tex/.
"""

import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import torch

from texsss.baker import Baker
from texsss.errors import TexsssError
from texsss.io.images import read_image
from texsss.scene import Scene

HEAD = """# Bad files and what texsss answers

Every file of a set of deliberately bad meshes and textures, baked at 64² (textures: read). Each gives a
correct result or one sentence that names the file, its fault and the remedy. Made by
`python -m benchmarks.hostile`.

| file | seconds | answer |
|---|---|---|
"""


def answers(folder: Path, size: int = 64) -> Iterator[tuple[str, float, str]]:
    """(file, seconds, answer) of every file in `folder`; its texture folder last.

    Raises whatever a file provokes that is not a sentence.
    """
    for path in sorted(folder.glob("*")) + sorted((folder / "tex").glob("*")):
        if path.is_file():
            start = time.perf_counter()
            try:
                said = _texture(path) if path.parent.name == "tex" else _baked(path, size)
            except TexsssError as error:
                said = str(error).replace(str(folder) + "/", "")
            yield str(path.relative_to(folder)), time.perf_counter() - start, said


def _baked(path: Path, size: int) -> str:
    camera = {"resolution": [32, 24], "samples": 1}
    scene = Scene.parse({"mesh": {"source": str(path)}, "atlas": {"size": size}, "camera": camera})
    baked = Baker().bake(scene)
    images = {"radiance": baked.radiance, "irradiance": baked.irradiance, "picture": baked.picture}
    for name, image in images.items():
        if not bool(torch.isfinite(image).all()):
            raise AssertionError(f"{path.name}: {name} is not finite")
    notes = "; ".join(baked.report["notes"])
    return f"baked, {baked.report['mesh']['faces']:,} faces" + (f": {notes}" if notes else "")


def _texture(path: Path) -> str:
    height, width, channels = read_image(path).shape
    return f"read, {width} × {height}, {channels} channels"


def main() -> None:
    rows = []
    for name, seconds, said in answers(Path(sys.argv[1])):
        rows.append(f"| `{name}` | {seconds:.1f} | {said.replace('|', '/')} |")
        print(rows[-1], flush=True)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    told = f"All of them in one process, which took {most:.1f} GB at its most.\n"
    print(told)
    if "--write" in sys.argv:
        Path(sys.argv[-1]).write_text(HEAD + "\n".join(rows) + "\n\n" + told, encoding="utf-8")


if __name__ == "__main__":
    main()
