"""Images and bakes as bytes of a media type. Equal inputs give equal bytes."""

import io
import json
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from texsss_server.problems import no_room

from texsss.errors import AssetError
from texsss.io.exr import write_exr
from texsss.io.gltf import write_glb
from texsss.io.images import encode_png
from texsss.result import FILES, Baked
from texsss.types import Float, Progress, Tensor

PICTURES = {
    "image/png": "png",
    "image/jpeg": "jpg",
    "image/webp": "webp",
    "image/x-exr": "exr",
    "application/x-npz": "npz",
    "application/x-npy": "npy",
}
"""Media types of images, best first, and how their files are called."""

LINEAR = ("image/x-exr", "application/x-npz", "application/x-npy")
"""Those that carry linear values (NPY in half precision); the others are encoded for a display."""

BAKES = {"model/gltf-binary": "glb", "application/zip": "zip"}
"""Media types of bakes, best first."""

JPEG_QUALITY = 90
HALF_MAX = 65504.0


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder for files that some writers need. Raises Problem: 507 when the disk takes no more."""
    try:
        with tempfile.TemporaryDirectory(prefix="texsss-") as folder:
            yield Path(folder)
    except (AssetError, OSError) as error:
        raise no_room(error) from None


def encoded(image: Float[Tensor, "H W C"], media_type: str, text: Mapping[str, str] | None = None) -> bytes:
    """An image in one of `PICTURES`: display values in 0..1, or linear ones for those in `LINEAR`.

    `text`: what a PNG says of itself.
    """
    image = image.detach()
    if media_type == "application/x-npy":
        out = io.BytesIO()
        np.save(out, image.clamp(-HALF_MAX, HALF_MAX).half().cpu().numpy())
        return out.getvalue()
    if media_type == "application/x-npz":
        out = io.BytesIO()
        np.savez(out, image=image.cpu().numpy())
        return out.getvalue()
    if media_type == "image/x-exr":
        with scratch() as folder:
            path = folder / "image.exr"
            write_exr(path, image, half=True)
            return path.read_bytes()
    if media_type == "image/png":
        return encode_png(image, text=text)
    levels = (torch.nan_to_num(image).clamp(0, 1) * 255 + 0.5).to(torch.uint8)
    levels = levels.expand(-1, -1, 3) if levels.shape[-1] == 1 else levels
    out = io.BytesIO()
    options = {"format": "JPEG"} if media_type == "image/jpeg" else {"format": "WEBP", "method": 2}
    Image.fromarray(levels.cpu().numpy()).save(out, quality=JPEG_QUALITY, **options)
    return out.getvalue()


def glb(baked: Baked) -> bytes:
    """The mesh with its baked texture."""
    with scratch() as folder:
        path = folder / "model.glb"
        texels = baked.texels
        write_glb(path, texels.mesh, texels.atlas_uv, baked.encode(baked.radiance.detach()))
        return path.read_bytes()


def archive(baked: Baked, progress: Progress) -> bytes:
    """The files of a bake in a ZIP, their dates and timings left out."""
    out = io.BytesIO()
    with scratch() as folder:
        written = baked.save(folder, progress=progress)
        with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as bundle:
            for name in FILES:
                data = written[name].read_bytes()
                if name == "report.json":
                    data = _timeless(data)
                bundle.writestr(zipfile.ZipInfo(name), data)
    return out.getvalue()


UNLIKE = ("seconds", "threads", "peak_memory_mb", "peak_memory_of_children_mb")  # from bake to bake


def _timeless(report: bytes) -> bytes:
    kept = {k: v for k, v in json.loads(report).items() if k not in UNLIKE}
    return json.dumps(kept, indent=2, sort_keys=True).encode() + b"\n"
