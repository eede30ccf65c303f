"""What Norberg 2010 shows of lightmaps and of textures beneath textures, on our own animal.

    python examples/papers_textures.py [FOLDER] [lightmap beneath]

One sheet per figure; `docs/papers.md` tells what to see in each.
"""

import sys
from pathlib import Path

import torch
from paper_views import HEAD, SIZE, Figures, Picture, close_up, parts, variant

from texsss import Scene

SIDE = {"type": "directional", "direction": [-1.0, 0.35, -0.15], "irradiance_w_per_m2": [4.2, 4.0, 3.8]}
FILL = {"type": "environment", "radiance": [0.07, 0.08, 0.10], "samples": 64}


class Textures(Figures):
    def lightmap(self) -> None:
        """Figures 11, 13 and 20: the lightmap, and the head without and with its blur."""

        def scene(method: str, **more) -> Scene:
            lit = {"lights": [SIDE, FILL], "camera": close_up(HEAD, 1.0)}
            return variant("veins-beneath", methods={"diffusion": method, **more}, **lit)

        def over_atlas(scene: Scene, name: str) -> Picture:
            return cut(self.baker.display(scene, self.baker.intermediate(scene, name) / 3))

        plain, soft, softer = (
            scene("none"),
            *(scene("poisson", poisson={"radius_mm": r}) for r in (1.0, 4.0)),
        )
        disc = "Poisson disc, 12 samples, 2 passes"
        rows = [
            [
                ("Lightmap", "over the atlas", over_atlas(plain, "irradiance")),
                ("No blur", "the lightmap as it is", self.whole(plain)),
                ("Blurred over 1 mm", disc, self.whole(soft)),
            ],
            [
                ("Blurred lightmap", "4 mm, over the atlas", over_atlas(softer, "diffused")),
                ("Blurred over 4 mm", f"{disc}; it stops at seams", self.whole(softer)),
                ("Ours", "skin1 over the surface: no seams", self.whole(scene("surface"))),
            ],
        ]
        self.write("papers-lightmap", rows, 3)

    def beneath(self) -> None:
        """Figures 19 and 21: vessels under skin, from a lamp at the eye, deeper and deeper."""
        camera = close_up(HEAD, 1.0)
        lamp = {
            "type": "directional",
            "direction": HEAD["direction"],
            "irradiance_w_per_m2": [3.0, 2.95, 2.85],
        }
        methods = parts("veins-beneath")["methods"]
        row = []
        for title, share in (("Just beneath", 0.2), ("Deeper", 1.0), ("Deeper still", 3.0)):
            inner = [
                layer | {"depth_mm": share * layer["depth_mm"], "spread": 0.25}
                for layer in methods["parallax"]["layers"]
            ]
            parallax = {"layers": inner}
            lit = {"lights": [lamp, FILL], "camera": camera}
            deeper = variant("veins-beneath", methods=methods | {"parallax": parallax}, **lit)
            depths = " and ".join(f"{layer['depth_mm']:.2g}" for layer in inner)
            row.append((title, f"each {depths} mm below the last", self.whole(deeper)))
        bare = variant("veins-beneath", methods={"diffusion": "none"}, lights=[lamp, FILL], camera=camera)
        self.write("papers-beneath", [[("Surface alone", "nothing beneath", self.whole(bare)), *row]], 4)


def cut(image: Picture) -> Picture:
    """A square image in the shape of a panel: its busiest rows."""
    small = torch.nn.functional.interpolate(
        image.permute(2, 0, 1)[None], size=(SIZE[0], SIZE[0]), mode="area"
    )
    return small[0].permute(1, 2, 0)[-SIZE[1] :]


def main() -> None:
    figures = Textures(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
    for name in sys.argv[2:] or ("lightmap", "beneath"):
        getattr(figures, name)()


if __name__ == "__main__":
    main()
