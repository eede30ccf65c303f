"""Every layer of the shipped scenes alone, and the layers together: a sheet of pictures.

    python examples/layers_alone.py [layers.jpg]

What Mayorga 2008 (figures 7 to 9) shows on a bunny: what lies below tells through what lies above.
"""

import sys
from pathlib import Path

import torch
from PIL import Image

from texsss import Baker, Scene, gallery

ROWS = ("two-tone-marble", "two-layers-vary", "veined-marble")
RESOLUTION = (560, 240)


def variants(scene: Scene) -> list[Scene]:
    """The bottom layer alone, the top layer alone (nothing below it), both."""
    data = scene.model_dump(mode="json", exclude_none=True)
    data["camera"]["resolution"] = RESOLUTION
    top, bottom = data["material"]["layers"]
    stacks = ([bottom], [top], [top, bottom])
    return [Scene.parse(data | {"material": data["material"] | {"layers": stack}}) for stack in stacks]


def main() -> None:
    baker = Baker()
    rows = []
    for name in ROWS:
        scenes = variants(gallery.scene(name))
        pictures = [baker.display(scene, baker.render(scene)) for scene in scenes]
        rows.append(torch.cat(pictures, dim=1))
        print(name, flush=True)
    sheet = (torch.cat(rows).clamp(0, 1) * 255).round().to(torch.uint8).numpy()
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "layers.jpg")
    Image.fromarray(sheet).save(out, quality=88)
    print(out)


if __name__ == "__main__":
    main()
