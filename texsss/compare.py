"""One scene by several methods: pictures side by side, differences, errors and seconds."""

import json
import math
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from texsss.baker import Baker
from texsss.errors import DomainError
from texsss.io.images import write_png
from texsss.io.sheet import COOL, WARM, Panel, difference_map, sheet, title_size, with_legend
from texsss.methods import ALONE, SPLITS
from texsss.result import staging
from texsss.scene import Scene
from texsss.types import Cancel, Float, Progress, Tensor

METHODS = ("none", "uv", "surface", "octree", "poisson", "parallax", "march-uniform", "march-exact")
DEFAULT = ("none", "poisson", "uv", "surface", "octree")
THROUGH = "+through"
FILES = ("compare.md", "compare.json", "compare.png")
COLUMNS = 5
SHOWN = 0.98  # quantile of the differences that shows at full strength


@dataclass(frozen=True)
class Row:
    """One method: seconds to bake and to take the picture, and how far it is from the reference.

    `rmse` of linear radiance, as a share of the reference's root mean square; `psnr` [dB] of the display
    values, None where they are equal; `mean`: ratio of the mean radiance.
    """

    method: str
    bake_s: float
    picture_s: float
    rmse: float
    psnr: float | None
    mean: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare` found; pictures (h, w, 3) are linear, over a black background.

    `operators_s`: what carrying light over the surface took to make, once; no method's seconds hold it.
    `alone`: whether parts that light each other were left out of all, since one method does not know them.
    """

    scene: Scene
    reference: str
    rows: tuple[Row, ...]
    pictures: tuple[Float[Tensor, "h w 3"], ...]
    display: tuple[Float[Tensor, "h w 3"], ...]
    operators_s: float = 0.0
    alone: bool = False

    def markdown(self) -> str:
        """The table."""
        lines = [
            f"Reference: {self.reference}. RMSE of linear radiance over the object, as a share of the",
            "reference's root mean square; PSNR of the displayed picture. What methods share is not timed.",
            "",
            "| method | bake s | picture s | RMSE | PSNR dB | mean |",
            "|---|---|---|---|---|---|",
        ]
        for row in self.rows:
            psnr = "∞" if row.psnr is None else f"{row.psnr:.1f}"
            lines.append(
                f"| {row.method} | {row.bake_s:.2f} | {row.picture_s:.2f} | {row.rmse:.2%} | {psnr} "
                f"| {row.mean:.3f} |"
            )
        if self.operators_s:
            lines += ["", f"Operators of the surface, made once before: {self.operators_s:.2f} s."]
        if self.alone:
            lines += ["", "Without the light that parts send each other, which not all of these know."]
        return "\n".join(lines) + "\n"

    def sheet(self) -> Float[Tensor, "H W 3"]:
        """Pictures above, differences to the reference below, and what their colours say."""
        expected = self.pictures[[row.method for row in self.rows].index(self.reference)]
        differences = [picture - expected for picture in self.pictures]
        sizes = torch.cat([d.mean(-1).abs()[expected.sum(-1) > 0] for d in differences])
        sizes = sizes[sizes > 0]
        full = float(sizes.sort().values[int(SHOWN * (len(sizes) - 1))]) if len(sizes) else 1.0
        level = float(expected[expected.sum(-1) > 0].mean()) if bool((expected > 0).any()) else 1.0
        above: list[Panel] = []
        below: list[Panel] = []
        for row, picture, difference in zip(self.rows, self.display, differences, strict=True):
            seconds = f"bake {row.bake_s:.1f} s"
            if row.method == self.reference:
                above.append((row.method, f"reference, {seconds}", picture))
            else:
                above.append((row.method, f"RMSE {row.rmse:.1%}, {seconds}", picture))
            note = f"full colour: ±{full / level:.0%} of the mean"
            if row.method != self.reference or len(self.rows) == 1:
                title = f"{row.method} against {self.reference}"
                below.append((title, note, difference_map(difference, full)))
        columns = -(-len(above) // -(-len(above) // COLUMNS))  # rows of one length, nearly
        words = [(WARM, f"brighter than {self.reference}"), (COOL, f"darker than {self.reference}")]
        line = round(1.5 * title_size(self.display[0].shape[1]))  # letters as large as those of titles
        return with_legend(sheet([above, below], columns), words, line)

    def save(self, folder: str | Path) -> dict[str, Path]:
        """Writes table, numbers and sheet into `folder`, all or none; gives their paths by name.

        Raises AssetError: when the folder can't be written.
        """
        folder = Path(folder)
        found = {
            "reference": self.reference,
            "methods": [vars(row) for row in self.rows],
            "operators_s": self.operators_s,
            "without_interreflection": self.alone,
            "threads": torch.get_num_threads(),
            "scene": self.scene.model_dump(mode="json"),
        }
        with staging(folder) as temporary:
            (temporary / "compare.md").write_text(self.markdown(), encoding="utf-8")
            (temporary / "compare.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
            write_png(temporary / "compare.png", self.sheet())
        return {name: folder / name for name in FILES}


def compare(
    scene: Scene,
    methods: tuple[str, ...] = DEFAULT,
    *,
    reference: str | None = None,
    baker: Baker | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Comparison:
    """`scene` baked and pictured by each of `methods`, all else being equal.

    A method is a diffusion, or march-uniform or march-exact (single scattering marched over `surface`);
    "+through" behind it adds light from the far side. Errors are to `reference`: octree, the last one with
    it, if left out, or else the first. What methods share is made before anything is timed. Parts light
    each other in none, if one of the methods does not know how.
    Raises DomainError: when a method or the reference is unknown, or named twice, or nothing lies beneath
    the surface for parallax, or a march has a profile that knows only the total; else as a bake.
    """
    lit, alone = scene.methods, any(name.removesuffix(THROUGH) in ALONE for name in methods)
    if alone:
        lit = lit.model_copy(update={"interreflection": 0, "angular": False})
    alone = alone and lit != scene.methods
    scene, given = scene.model_copy(update={"methods": lit}), scene
    scenes = {}
    for name in methods:
        if name in scenes:
            raise DomainError(f"compare: {name} is named twice; name every method once.")
        scenes[name] = asked(scene, name)
    if not methods:
        raise DomainError(f"compare: expected one method or more of {', '.join(METHODS)}, got none.")
    reference = reference or next((m for m in reversed(methods) if m.startswith("octree")), methods[0])
    if reference not in scenes:
        raise DomainError(f"compare: the reference {reference!r} is not among {', '.join(methods)}; add it.")
    baker = baker or Baker()
    hooks = {"progress": progress, "cancel": cancel}
    # mesh, atlas, light and rays are made once, and left out of the seconds
    shared = asked(scene, "none")
    _ = baker.bake(shared, **hooks).picture
    pictures, display, seconds, operators_s = [], [], [], 0.0
    for name in methods:
        begin = time.perf_counter()
        baked = baker.bake(scenes[name], **hooks)
        middle = time.perf_counter()
        operators = baked.report["seconds"].get("operators", 0.0)
        operators_s += operators
        pictures.append(baked.picture.detach())
        seconds.append((middle - begin - operators, time.perf_counter() - middle))
        display.append(baked.encode(pictures[-1]).clamp(0, 1))
    number = methods.index(reference)
    rows = tuple(
        _row(name, seconds[i], (pictures[i], pictures[number]), (display[i], display[number]))
        for i, name in enumerate(methods)
    )
    return Comparison(given, reference, rows, tuple(pictures), tuple(display), operators_s, alone)


def asked(scene: Scene, name: str) -> Scene:
    """The scene by one method, over a black background.

    Raises DomainError: when the name is unknown, or marches beside a profile of the total.
    """
    method = name.removesuffix(THROUGH)
    if method not in METHODS:
        raise DomainError(
            f"compare: expected methods of {', '.join(METHODS)}, {THROUGH} behind them or not, got {name!r}."
        )
    kind = method.removeprefix("march-")
    change = {"diffusion": "surface", "single_scattering": kind} if kind != method else {"diffusion": method}
    if kind != method and scene.methods.profile not in SPLITS:
        raise DomainError(
            f"compare: {name} marches what methods.profile {scene.methods.profile!r}, which knows only the "
            f"total, holds already; choose {' or '.join(SPLITS)}, or leave {name} out."
        )
    change = {"single_scattering": "none"} | change | {"transmission": name.endswith(THROUGH)}
    if method in ALONE:
        change |= {"interreflection": 0, "angular": False}
    if method == "parallax" and not scene.methods.parallax.layers:
        raise DomainError(
            "compare: parallax shows textures beneath the surface, and methods.parallax.layers names none; "
            "add one, or leave parallax out."
        )
    return scene.model_copy(
        update={
            "methods": scene.methods.model_copy(update=change),
            "output": scene.output.model_copy(update={"background": (0.0, 0.0, 0.0)}),
        }
    )


def _row(
    name: str, seconds: tuple[float, float], linear: tuple[Tensor, Tensor], display: tuple[Tensor, Tensor]
) -> Row:
    found, expected = (x.double() for x in linear)
    seen = (found.sum(-1) > 0) | (expected.sum(-1) > 0)
    found, expected = found[seen], expected[seen]
    size = float(expected.square().mean().sqrt()) if len(expected) else 0.0
    wrong = float((found - expected).square().mean().sqrt()) if len(expected) else 0.0
    squared = float((display[0] - display[1])[seen].double().square().mean()) if len(expected) else 0.0
    return Row(
        method=name,
        bake_s=seconds[0],
        picture_s=seconds[1],
        rmse=wrong / size if size > 0 else 0.0,
        psnr=None if squared == 0 else -10 * math.log10(squared),
        mean=float(found.mean() / expected.mean()) if size > 0 else 1.0,
    )
