"""What the sheets of the papers' figures share: close-ups of shipped scenes, and files of pictures."""

from pathlib import Path

import torch
from PIL import Image

from texsss import Baker, Scene, gallery
from texsss.baker import lasting_shelf
from texsss.io.sheet import sheet
from texsss.types import Float, Tensor, unit

SIZE = [390, 292]
FLANK = {"direction": [-0.95, 0.22, -0.12], "target": [-8.0, 17.0, 8.0], "height": 58.0}
HEAD = {"direction": [-0.62, 0.42, 0.62], "target": [2.0, 27.0, 78.0], "height": 52.0}
Picture = Float[Tensor, "H W 3"]


def close_up(where: dict, unit_mm: float, **more) -> dict:
    """A camera that looks at a place of the animal, in millimetres of its mesh."""
    target = torch.tensor(where["target"]) * unit_mm
    away = unit(torch.tensor(where["direction"])) * where["height"] * unit_mm / 0.3168  # 2 tan 9°
    place = {"position_mm": (target + away).tolist(), "target_mm": target.tolist()}
    return {"fov_y_deg": 18.0, "resolution": SIZE, "samples": 9} | place | more


def parts(name: str) -> dict:
    """A shipped scene as JSON."""
    return gallery.scene(name).model_dump(mode="json", exclude_none=True)


def variant(name: str, **changes) -> Scene:
    """A shipped scene with some of its parts replaced."""
    return Scene.parse(parts(name) | changes)


class Figures:
    """A folder that sheets are written to, and what is kept between their pictures."""

    def __init__(self, folder: Path):
        self.folder, self.baker = folder, Baker(shelf=lasting_shelf())
        folder.mkdir(parents=True, exist_ok=True)

    def write(self, name: str, rows: list, columns: int) -> None:
        page = (sheet(rows, columns) * 255).round().to(torch.uint8).numpy()
        Image.fromarray(page).save(self.folder / f"{name}.jpg", quality=86)
        print(self.folder / f"{name}.jpg", flush=True)

    def whole(self, scene: Scene) -> Picture:
        """The picture, ready to be shown."""
        return self.baker.display(scene, self.baker.render(scene))

    def once(self, scene: Scene) -> Picture:
        """Light scattered once alone, linear."""
        return self.baker.intermediate(scene, "single")
