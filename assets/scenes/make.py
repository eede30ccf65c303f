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
from organs import gecko, organs  # noqa: E402
from shape import Axolotl  # noqa: E402

SIZE = 1024
COARSE = 512  # for what has no sharp edges
FINER = {"marble-depth": 1024, "marble-veins": 1024, "patches": 1024, "fish-blood": 1024, "fish-organs": 1024}
SIZES = FINER | {"gecko-scales": 768}
# between greys: no one tells the steps of so thin a scale, or of .2 mm of marble, and files are half as large
STEPS = {"gecko-scales": 8.5, "marble-depth": 3, "marble-veins": 3}
MARBLE_ETA = 1.5
FISH_ETA = 1.35  # the published numbers ignore refraction; this gives them a wet skin
CAMERA = {"direction": [0.62, 0.36, 0.7], "fov_y_deg": 18.0, "resolution": [1120, 630]}
VESSEL = (104, 32, 62)  # sRGB


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


def flesh(at: Array) -> Array:
    """What lies beneath the skin of an animal: muscle in strands, darker between them (N, 3), sRGB."""
    strand = fractal(at * np.array([1.0, 1.0, 0.28]), 5.0, 4, 170)
    patch = fractal(at, 26.0, 3, 180)
    dark, bright = np.array([0.42, 0.07, 0.09]), np.array([0.80, 0.27, 0.24])
    return dark + (bright - dark) * smoothstep(-0.5, 0.5, strand + 0.6 * patch)[:, None]


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
        "white-marble": {
            "summary": "White marble all through; methods.diffusion none shows it without",
            "maps": [],
            "media": {},
            "layers": [{"medium": "marble"}],
        },
        "green-marble": {
            "summary": "Green marble all through: texsss profile green-marble.json draws its profile",
            "maps": [],
            "media": {"jade": jade},
            "layers": [{"medium": "jade"}],
        },
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


def beneath() -> dict:
    """Vessels and flesh beneath the axolotl's skin, as textures that shift with the view."""
    layers = [
        {"base": "vessels", "depth_mm": 0.7, "opacity": "veins", "spread": 0.1},
        {"base": "flesh", "depth_mm": 1.8, "spread": 0.15},
    ]

    def image(builtin: str, space: str) -> dict:
        return {"source": {"builtin": builtin}, "space": space}

    return {
        "summary": "Vessels and flesh beneath pale skin, as textures that shift with the view",
        "maps": {
            "albedo": image("axolotl/albedo.png", "srgb"),
            "veins": image("axolotl/veins.png", "linear"),
            "vessels": image("scenes/vessels.png", "srgb"),
            "flesh": image("scenes/flesh.png", "srgb"),
        },
        "material": {
            "layers": [{"medium": "skin1"}],
            "surface": {"albedo": "albedo", "roughness": 0.3},
        },
        "methods": {"diffusion": "parallax", "parallax": {"opacity": 0.35, "layers": layers}},
    }


def marched() -> dict[str, dict]:
    """The scenes that show depth by light scattered once (François et al. 2006), by name."""

    def mapped(name: str, low: float, high: float, invert: bool = False) -> dict:
        return {"map": name, "range": [low, high], "invert": invert}

    def published(sigma_a: float, sigma_s: list[float], g: float) -> dict:
        return {"sigma_a_per_mm": [sigma_a] * 3, "sigma_s_per_mm": sigma_s, "g": g, "eta": FISH_ETA}

    def lamp(position: list[float], strength: float, colour: tuple[float, ...]) -> dict:
        watts = [round(strength * c, 4) for c in colour]
        return {"type": "point", "position_mm": position, "intensity_w_per_sr": watts}

    fish = {
        "summary": "A fish one sees into: dermis, blood and organs, light from the front, beneath and behind",
        "maps": ["fish-blood", "fish-organs"],
        "media": {
            "dermis": published(0.6, [2.0, 1.0, 1.0], 0.25),
            "blood": published(0.6, [6.0, 3.0, 2.0], 0.4),
            "organs": published(0.5, [1.0, 1.0, 2.0], 0.8),
        },
        "layers": [
            {"medium": "dermis", "thickness_mm": 0.05},
            {"medium": "blood", "thickness_mm": mapped("fish-blood", 0.0, 0.6)},
            {"medium": "organs", "thickness_mm": mapped("fish-organs", 0.05, 1.6, invert=True)},
        ],
        "unit_mm": 0.3,
        "lights": [
            lamp([-110.0, 90.0, 30.0], 0.34, (1.0, 0.96, 0.9)),
            lamp([-60.0, -70.0, -20.0], 0.12, (0.85, 0.93, 1.0)),
            lamp([90.0, 70.0, -40.0], 0.3, (0.9, 0.95, 1.0)),
        ],
        "direction": [-0.95, 0.22, -0.12],
    }
    lizard = {
        "summary": "Bumpy skin of a gecko: scales over dark spots, which show more or less with the view",
        "maps": ["gecko-scales", "gecko-spots"],
        "media": {
            "horn": medium((0.82, 0.74, 0.36), 0.3),
            "pigment": medium((0.10, 0.06, 0.04), 0.12),
            "tissue": medium((0.30, 0.55, 0.16), 0.35),
        },
        "layers": [
            {"medium": "horn", "thickness_mm": mapped("gecko-scales", 0.0, 0.35)},
            {"medium": "pigment", "thickness_mm": mapped("gecko-spots", 0.0, 0.1)},
            {"medium": "tissue"},
        ],
        "unit_mm": 0.5,
        "lights": [{"type": "studio", "intensity": 2.4}],
        "direction": [-0.6, 0.5, 0.7],
    }
    return {"fish-organs": fish, "gecko": lizard}


def layered(scene: dict) -> dict:
    """What a scene of layers under every texel states."""
    return {
        "summary": scene["summary"],
        "maps": {name: {"source": {"builtin": f"scenes/{name}.png"}} for name in scene["maps"]},
        "media": scene["media"],
        "material": {"layers": scene["layers"], "surface": {"roughness": 0.3}},
        "methods": {"diffusion": "surface"},
    }


def seen_into(scene: dict) -> dict:
    """What a scene of layers states whose light scattered once is marched."""
    direction = {"direction": scene["direction"]}
    methods = {"diffusion": "surface", "single_scattering": "exact"}
    more = {"methods": methods, "lights": scene["lights"], "camera": CAMERA | direction}
    mesh = {"source": {"builtin": "axolotl/axolotl.obj"}, "unit_mm": scene["unit_mm"]}
    return layered(scene) | more | {"mesh": mesh}


def stated(scene: dict) -> dict:
    """The whole scene."""
    shared = {
        "mesh": {"source": {"builtin": "axolotl/axolotl.obj"}, "unit_mm": 1.0},
        "atlas": {"size": 512},
        "lights": [{"type": "studio", "intensity": 1.3}],
        "camera": CAMERA,
        "output": {"tonemap": "aces"},
    }
    return {"version": 1} | scene | {name: part for name, part in shared.items() if name not in scene}


def main() -> None:
    """Paint, then write."""
    at, animal = positions(), Axolotl()
    with Image.open(HERE.parent / "axolotl" / "veins.png") as veins:
        vessels = np.asarray(veins.convert("L").resize((SIZE, SIZE))).reshape(-1) / 255.0
    painted = maps(at) | {"flesh": flesh(at)} | organs(animal, at, vessels) | gecko(animal, at)
    for name, values in painted.items():
        image = np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
        edge = SIZES.get(name, COARSE)
        drawn = Image.fromarray(image.reshape(SIZE, SIZE, *values.shape[1:]))
        drawn = drawn.resize((edge, edge), Image.Resampling.BOX)
        if name in STEPS:
            drawn = drawn.point([round(round(i / STEPS[name]) * STEPS[name]) for i in range(256)])
        drawn.save(HERE / f"{name}.png", optimize=True)
    Image.new("RGB", (4, 4), VESSEL).save(HERE / "vessels.png")
    written = {name: layered(scene) for name, scene in scenes().items()} | {"veins-beneath": beneath()}
    written |= {name: seen_into(scene) for name, scene in marched().items()}
    for name, scene in written.items():
        text = json.dumps(stated(scene), indent=2) + "\n"
        (HERE / f"{name}.json").write_text(text)
        Scene.load(HERE / f"{name}.json")


if __name__ == "__main__":
    main()
