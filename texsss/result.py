"""What a bake gives back: images over the atlas, and the files they become."""

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch

from texsss.errors import AssetError, DomainError
from texsss.io.exr import write_exr
from texsss.io.gltf import write_glb
from texsss.io.images import encode_png, write_png
from texsss.profiles.weights import Weights
from texsss.reading import Reading, reading
from texsss.surface.points import TexelMaps
from texsss.types import Bool, Float, Progress, Tensor

FILES = ("irradiance.exr", "radiance.exr", "radiance.png", "preview.png", "model.glb", "report.json")


@dataclass(frozen=True, eq=False)
class Baked:
    """A baked scene. Images are (H, W, 3) over the atlas, v down, dilated to the full square.

    `texels`: the points that the values lie on. `texel_irradiance`, `texel_exitance` (P, 3): entered
    irradiance and exitance [W/m²]. `weights`: of the bank's Gaussians. `take_picture` renders the
    preview (linear RGB); `encode` turns linear RGB into display values in 0..1 as the scene's output asks.
    """

    texels: TexelMaps
    texel_irradiance: Float[Tensor, "P 3"]
    texel_exitance: Float[Tensor, "P 3"]
    weights: Weights | None
    make_report: Callable[[], dict]
    take_picture: Callable[[], Tensor]
    encode: Callable[[Tensor], Tensor]

    @property
    def report(self) -> dict:
        """What report.json says: seconds per stage made so far, texels, variances, energy, the scene."""
        return self.make_report()

    @cached_property
    def coverage(self) -> Bool[Tensor, "H W"]:
        """Which texels lie on the surface."""
        covered = self.texels.index[self.texels.covered]
        height, width = self.texels.size
        flat = torch.zeros(height * width, dtype=torch.bool, device=covered.device)
        flat[covered] = True
        return flat.reshape(height, width)

    @cached_property
    def irradiance(self) -> Float[Tensor, "H W 3"]:
        """Irradiance that entered the surface [W/m²]."""
        return self.image(self.texel_irradiance)

    @cached_property
    def exitance(self) -> Float[Tensor, "H W 3"]:
        """Exitance M [W/m²]: the scattered light that leaves, albedo included."""
        return self.image(self.texel_exitance)

    @cached_property
    def radiance(self) -> Float[Tensor, "H W 3"]:
        """M/π [W/(m² sr)]: what a diffuse surface of this exitance shows."""
        return self.exitance / torch.pi

    @cached_property
    def picture(self) -> Float[Tensor, "h w 3"]:
        """The preview, linear RGB."""
        return self.take_picture()

    def image(self, values: Float[Tensor, "P C"]) -> Float[Tensor, "H W C"]:
        """Values at the texels as an image dilated to the full square."""
        laid = self.texels.to_image(values)
        return (
            laid.reshape(-1, laid.shape[-1])
            .index_select(0, self.texels.nearest.reshape(-1))
            .reshape(laid.shape)
        )

    def save_picture(self, path: str | Path) -> None:
        """Writes the picture alone: PNG display-encoded, EXR linear.

        Raises AssetError: when it can't be written. Raises DomainError: for another ending.
        """
        path = Path(path)
        if path.suffix.lower() not in (".png", ".exr"):
            raise DomainError(
                f"Output: expected a name that ends in .png or .exr, got {path.name!r}; rename it."
            )
        with staging(path.parent) as temporary:
            if path.suffix.lower() == ".exr":
                write_exr(temporary / path.name, self.picture.detach())
            else:
                write_png(temporary / path.name, self.encode(self.picture.detach()))

    def save(self, folder: str | Path, *, progress: Progress | None = None) -> dict[str, Path]:
        """Writes the six files of a bake into `folder`, all or none; gives their paths by name.

        radiance.png and preview.png are display-encoded; the EXRs are linear; model.glb
        carries the baked texture unlit, in metres. EXRs are written
        beside the picture; the report's seconds of `files` are those after it.
        Raises AssetError: when the folder can't be written.
        """
        folder, tell = Path(folder), progress or (lambda stage, fraction: None)
        tell("files", 0.0)
        # dilating and compressing leave Python free: they run beside the picture
        with staging(folder) as temporary, ThreadPoolExecutor(1) as beside:

            def linear() -> Tensor:
                write_exr(temporary / "irradiance.exr", self.irradiance.detach())
                write_exr(temporary / "radiance.exr", self.radiance.detach())
                return self.radiance.detach()

            written = beside.submit(linear)
            preview = self.encode(self.picture.detach())
            start = time.perf_counter()
            write_png(temporary / "preview.png", preview)
            texture = encode_png(self.encode(written.result()))
            (temporary / "radiance.png").write_bytes(texture)
            write_glb(temporary / "model.glb", self.texels.mesh, self.texels.atlas_uv, texture)
            report = self.report
            report["seconds"]["files"] = round(time.perf_counter() - start, 4)
            text = json.dumps(report, indent=2) + "\n"
            (temporary / "report.json").write_text(text, encoding="utf-8")
        tell("files", 1.0)
        return {name: folder / name for name in FILES}


def save_map(path: str | Path, name: str, image: Float[Tensor, "H W C"]) -> Reading:
    """Writes what lies between the stages under `name`, of one channel as grey; says how to read it.

    EXR has the values as they are; PNG from black to white, which its text names.
    Raises AssetError: when it can't be written.
    """
    path, found = Path(path), reading(name, image)
    image = image.detach().expand(-1, -1, max(image.shape[-1], 3))
    with staging(path.parent) as temporary:
        if path.suffix.lower() == ".exr":
            write_exr(temporary / path.name, image)
        else:
            write_png(temporary / path.name, found.shown(image), text=found.text)
    return found


class staging:
    """A folder to write into whose files move to `folder` together when nothing failed.

    When something did, nothing stays: neither files nor folders that were made for them.
    Raises AssetError: when `folder` can't be made or written.
    """

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)
        self.made: list[Path] = []  # folders that were not there before, innermost first

    def __enter__(self) -> Path:
        try:
            self.made = [place for place in (self.folder, *self.folder.parents) if not place.exists()]
            self.folder.mkdir(parents=True, exist_ok=True)
            self.temporary = Path(tempfile.mkdtemp(prefix=".texsss-", dir=self.folder))
        except OSError as error:
            raise unwritable(self.folder, error) from None
        return self.temporary

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        try:
            if kind is None:
                files = sorted(self.temporary.iterdir())
                for file in files:
                    if (self.folder / file.name).is_dir():
                        raise AssetError(
                            f"Output: expected a file or nothing, got a folder at {self.folder / file.name}; "
                            "choose another with --out."
                        )
                for file in files:
                    os.replace(file, self.folder / file.name)
        except OSError as failure:
            raise unwritable(self.folder, failure) from None
        finally:
            shutil.rmtree(self.temporary, ignore_errors=True)
            for place in self.made:
                with suppress(OSError):  # not empty: something was written
                    place.rmdir()
        if isinstance(error, OSError):
            raise unwritable(self.folder, error) from None
        if (
            isinstance(error, AssetError)
            and error.__cause__ is not None
            and str(self.temporary) in str(error)
        ):
            raise unwritable(self.folder, error.__cause__) from None  # told of a folder that is gone


def unwritable(folder: Path, error: BaseException) -> AssetError:
    """The one sentence for an output folder that refuses."""
    reason = getattr(error, "strerror", None) or error
    return AssetError(f"Output: {folder} cannot be written ({reason}); choose another with --out.")
