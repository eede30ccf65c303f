"""Where two ways to the same light differ, on the object: false colours, marked places, a scale."""

import math

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from texsss.io.sheet import INK, PAPER, difference_map, sheet
from texsss.light.visibility import Occluder
from texsss.numerics.sampling import bilinear
from texsss.surface.points import TexelMaps
from texsss.types import Float, Tensor
from texsss.view.camera import Camera, Hits, fit_camera, pixel_centres, primary_hits

FULL = 0.3  # of the RMS of the light, at full strength
RESOLUTION = (420, 520)
VIEWS = {"front": (0.0, 0.05, 1.0), "side": (1.0, 0.1, 0.35)}
MARKS = {
    "front": {
        "lid": (19.8, -0.9, 11.1),
        "lips": (3.3, -41.0, 19.8),
        "ear": (46.3, -16.4, -46.2),
        "shadow's edge": (-69.5, -116.4, -56.8),
    },
    "side": {
        "lid": (25.4, -4.7, 6.7),
        "ear": (51.2, -11.6, -45.0),
        "nostril": (-1.5, -28.3, 21.5),
        "lips": (5.5, -50.0, 18.6),
    },
}
"""Places of a head of 240 mm [mm], in the view that shows them."""
BAR = 46  # pixels

Panel = tuple[str, str, Float[Tensor, "P 3"]]
"""A title, a line below it, and values at the texels: display values in the first, differences in others."""


def drawn(texels: TexelMaps, panels: list[Panel]) -> Float[Tensor, "h w 3"]:
    """The panels from every side of `VIEWS`, row by row, and the scale of their differences."""
    occluder, rows = Occluder(texels.mesh), []
    for name, direction in VIEWS.items():
        camera = fit_camera(texels.mesh, direction=direction, fov_y=math.radians(20), resolution=RESOLUTION)
        everywhere = torch.arange(math.prod(RESOLUTION))
        hits = primary_hits(camera, occluder, pixel_centres(camera), everywhere, torch.float32)
        row = []
        for k, (title, note, values) in enumerate(panels):
            colour = values if k == 0 else difference_map(values, FULL)
            row.append((title, note, marked(image_of(texels, hits, colour), camera, name, light=k == 0)))
        rows.append(row)
    above = sheet(rows, len(panels))
    return torch.cat([above, scale(above.shape[1])])


def image_of(texels: TexelMaps, hits: Hits, values: Float[Tensor, "P 3"]) -> Float[Tensor, "h w 3"]:
    """Values at the texels as the camera sees them."""
    width, height = RESOLUTION
    picture = torch.zeros(width * height, 3)
    picture[hits.pixel] = bilinear(texels.to_image(values), hits.points.uv(texels.atlas_uv))
    return picture.reshape(height, width, 3)


def marked(picture: Float[Tensor, "h w 3"], camera: Camera, view: str, light: bool) -> Float[Tensor, "h w 3"]:
    """A picture with a ring and a word at every place of `MARKS`."""
    paper = Image.fromarray((picture.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy())
    draw, font = ImageDraw.Draw(paper), ImageFont.load_default(14)
    for name, place in MARKS[view].items():
        x, y, _ = camera.project(torch.tensor([place], dtype=torch.float64))[0].tolist()
        draw.ellipse((x - 15, y - 15, x + 15, y + 15), outline=INK, width=1)
        if light:
            # over the object words need an edge
            draw.text((x + 18, y - 9), name, fill=INK, font=font, stroke_width=2, stroke_fill=PAPER)
    return torch.from_numpy(np.asarray(paper).copy()).float() / 255


def scale(width: int) -> Float[Tensor, "h w 3"]:
    """A bar of all differences with what they mean."""
    long, high = width // 2, 14
    ramp = torch.linspace(-FULL, FULL, long)[None, :, None].expand(high, -1, 3)
    colours = (difference_map(ramp, FULL) * 255 + 0.5).to(torch.uint8).numpy()
    paper = Image.new("RGB", (width, BAR), PAPER)
    left = width // 4
    paper.paste(Image.fromarray(colours), (left, 4))
    draw, font = ImageDraw.Draw(paper), ImageFont.load_default(14)
    for share in (-1.0, -0.25, 0.0, 0.25, 1.0):
        x = left + (share + 1) / 2 * long
        draw.line((x, 4, x, 4 + high), fill=INK)
        draw.text((x, 5 + high), f"{share * FULL:+.1%}" if share else "0", fill=INK, font=font, anchor="ma")
    draw.text((left - 10, 2), "surface is darker", fill=INK, font=font, anchor="ra")
    draw.text((left + long + 10, 2), "brighter, by the RMS of all light", fill=INK, font=font)
    return torch.from_numpy(np.asarray(paper).copy()).float() / 255
