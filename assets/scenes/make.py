"""Paints the maps of the layered scenes and writes the scenes. Run: ``python make.py`` in this folder.

Needs texsss and what ``../axolotl`` needs.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from texsss import Baker, Scene
from texsss.media.artist import from_colour

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "axolotl"))
from fields import Array, fractal, smoothstep  # noqa: E402

SIZE = 1024
MARBLE_ETA = 1.5


def positions() -> Array:
    """Where every texel of the axolotl lies (SIZE², 3) [mm]."""
    scene = Scene.parse({"atlas": {"size": SIZE}, "methods": {"diffusion": "none"}})
    return Baker().intermediate(scene, "position").reshape(-1, 3).double().numpy()


def maps(at: Array) -> dict[str, Array]:
    """Values 0..1 as functions of the position, so that they are continuous across seams."""
    warp = np.stack([fractal(at, 34.0, 3, 110 + k) for k in range(3)], axis=1)
    bent = at + 14.0 * warp
    wide = np.abs(fractal(bent, 46.0, 4, 120))
    fine = np.abs(fractal(bent, 17.0, 4, 130))
    veins = np.maximum(smoothstep(0.11, 0.0, wide), 0.6 * smoothstep(0.07, 0.0, fine))
    return {
        "tones": smoothstep(-0.16, 0.16, fractal(bent, 42.0, 4, 140)),
        "patches": smoothstep(-0.05, 0.05, fractal(at, 15.0, 3, 150)),
        "marble-veins": veins,
        "marble-depth": np.clip(0.5 + 0.8 * fractal(at, 24.0, 4, 160), 0.0, 1.0) * (1.0 - 0.8 * veins),
    }


def medium(colour: tuple[float, ...], path_mm: tuple[float, ...] | float) -> dict:
    """The medium of a colour and a mean free path, as a scene states it."""
    found = from_colour(list(colour), list(path_mm) if isinstance(path_mm, tuple) else path_mm)
    numbers = {
        "sigma_a_per_mm": [round(float(x), 5) for x in found.sigma_a.expand(3)],
        "sigma_s_per_mm": [round(float(x), 5) for x in found.sigma_s.expand(3)],
    }
    return numbers | {"eta": MARBLE_ETA}


def scenes() -> dict[str, dict]:
    """The scenes by name, but for what they share."""
    jade, jasper = medium((0.07, 0.36, 0.13), 0.7), medium((0.55, 0.06, 0.035), 0.7)
    white = {"preset": "marble"}
    plum = medium((0.30, 0.06, 0.42), 0.7)
    mist = medium((0.80, 0.79, 0.76), 6.0)
    chalk = medium((0.86, 0.84, 0.80), 0.35)
    calcite, soot = medium((0.93, 0.91, 0.87), 2.0), medium((0.11, 0.105, 0.12), 0.4)

    def mapped(name: str, low: float, high: float) -> dict:
        return {"map": name, "range": [low, high]}

    return {
        "two-tone-marble": {
            "summary": "Green and red stone beneath .78 mm of white marble",
            "maps": ["tones"],
            "media": {"jade": jade, "jasper": jasper, "white": white},
            "layers": [
                {"medium": "white", "thickness_mm": 0.78},
                {"medium": {"mix": ["jade", "jasper"], "mask": "tones"}},
            ],
        },
        "two-layers-vary": {
            "summary": "Green and plum stone beneath half a millimetre that is misty here and chalky there",
            "maps": ["tones", "patches"],
            "media": {"jade": jade, "plum": plum, "mist": mist, "chalk": chalk},
            "layers": [
                {"medium": {"mix": ["mist", "chalk"], "mask": "patches"}, "thickness_mm": 0.5},
                {"medium": {"mix": ["jade", "plum"], "mask": "tones"}},
            ],
        },
        "veined-marble": {
            "summary": "White marble, 2 to 20 mm thick, over dark veins",
            "maps": ["marble-veins", "marble-depth"],
            "media": {"calcite": calcite, "soot": soot},
            "layers": [
                {"medium": "calcite", "thickness_mm": mapped("marble-depth", 2.0, 20.0)},
                {"medium": {"mix": ["calcite", "soot"], "mask": "marble-veins"}},
            ],
        },
    }


def stated(scene: dict) -> dict:
    """The whole scene."""
    source = {name: {"source": {"builtin": f"scenes/{name}.png"}} for name in scene["maps"]}
    return {
        "version": 1,
        "summary": scene["summary"],
        "mesh": {"source": {"builtin": "axolotl/axolotl.obj"}, "unit_mm": 1.0},
        "atlas": {"size": 512},
        "maps": source,
        "media": scene["media"],
        "material": {"layers": scene["layers"], "surface": {"roughness": 0.3}},
        "lights": [{"type": "studio", "intensity": 1.3}],
        "camera": {"direction": [0.62, 0.36, 0.7], "fov_y_deg": 18.0, "resolution": [1120, 630]},
        "methods": {"diffusion": "surface"},
        "output": {"tonemap": "aces"},
    }


def main() -> None:
    """Paint, then write."""
    for name, values in maps(positions()).items():
        grey = np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
        Image.fromarray(grey.reshape(SIZE, SIZE)).save(HERE / f"{name}.png", optimize=True)
    for name, scene in scenes().items():
        text = json.dumps(stated(scene), indent=2) + "\n"
        (HERE / f"{name}.json").write_text(text)
        Scene.load(HERE / f"{name}.json")


if __name__ == "__main__":
    main()
