"""Every layer of the shipped scenes alone, and the layers together: a sheet of pictures.

    python examples/layers_alone.py [layers.jpg] [with.jpg]

What Mayorga 2008 (figures 7 to 9) shows on a bunny: what lies below tells through what lies above. The
second sheet is his figure 1: marble without scattering beneath the surface, and with it.
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


def with_and_without() -> list[Scene]:
    """White marble that scatters nothing beneath its surface, and as it is."""
    data = gallery.scene("white-marble").model_dump(mode="json", exclude_none=True)
    data["camera"]["resolution"] = RESOLUTION
    return [
        Scene.parse(data | {"methods": data["methods"] | {"diffusion": diffusion}})
        for diffusion in ("none", "surface")
    ]


def row(baker: Baker, scenes: list[Scene]) -> torch.Tensor:
    """Pictures side by side."""
    return torch.cat([baker.display(scene, baker.render(scene)) for scene in scenes], dim=1)


def save(rows: list[torch.Tensor], path: str) -> None:
    sheet = (torch.cat(rows).clamp(0, 1) * 255).round().to(torch.uint8).numpy()
    Image.fromarray(sheet).save(Path(path), quality=88)
    print(path, flush=True)


def main() -> None:
    baker = Baker()
    out = (*sys.argv[1:], *("layers.jpg", "with.jpg")[len(sys.argv) - 1 :])
    save([row(baker, variants(gallery.scene(name))) for name in ROWS], out[0])
    save([row(baker, with_and_without())], out[1])


if __name__ == "__main__":
    main()
