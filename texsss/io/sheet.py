"""Pictures side by side with labels, with a legend, and differences in false colours."""

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from texsss.errors import ShapeError
from texsss.types import Float, Tensor

GAP = 6  # pixels between panels
LEGEND = 480  # pixels that two columns of a legend take at least
PAPER, INK, SOFT = (24, 26, 30), (236, 238, 240), (160, 166, 174)
WARM, COOL, NEUTRAL = (1.0, 0.42, 0.12), (0.15, 0.5, 1.0), 0.16

Panel = tuple[str, str, Float[Tensor, "H W 3"]]
"""A title, a line below it, and display values in 0..1."""


def sheet(rows: list[list[Panel]], columns: int) -> Float[Tensor, "h w 3"]:
    """Rows of labelled panels, each of at most `columns` side by side, as display values in 0..1.

    Raises ShapeError: when there is none, or panels differ in size.
    """
    lines = [row[start : start + columns] for row in rows for start in range(0, len(row), columns)]
    sizes = {panel[2].shape for line in lines for panel in line}
    if len(sizes) != 1:
        raise ShapeError(
            f"sheet: expected pictures of one size, got {sorted(map(tuple, sizes)) or 'none'}; "
            "pass some, all alike."
        )
    height, width, _ = sizes.pop()
    title = title_size(width)
    head = 3 * title
    across = max(len(line) for line in lines)
    paper = Image.new("RGB", (across * (width + GAP) + GAP, len(lines) * (height + head + GAP) + GAP), PAPER)
    draw = ImageDraw.Draw(paper)
    large, small = ImageFont.load_default(title), ImageFont.load_default(round(0.75 * title))
    for i, line in enumerate(lines):
        for j, (name, note, picture) in enumerate(line):
            left, top = GAP + j * (width + GAP), GAP + i * (height + head + GAP)
            draw.text((left + 4, top), name, fill=INK, font=large)
            draw.text((left + 4, top + round(1.35 * title)), note, fill=SOFT, font=small)
            pixels = (picture.detach().clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()
            paper.paste(Image.fromarray(pixels), (left, top + head))
    return torch.from_numpy(np.asarray(paper).copy()).float() / 255


def title_size(width: int) -> int:
    """Pixels of the titles of panels that are `width` pixels wide."""
    return max(12, round(width / 22))


def with_legend(
    image: Float[Tensor, "H W 3"],
    entries: list[tuple[tuple[float, float, float], str]],
    line: int | None = None,
) -> Float[Tensor, "h w 3"]:
    """A picture of display values with a line for every (colour, what it means) below it.

    Small pictures are enlarged by a whole number, so that the lines fit beside each other. `line`: the height
    of one in pixels, a fortieth of the width if left out.
    """
    scale = -(-LEGEND // image.shape[1])
    image = image.repeat_interleave(scale, 0).repeat_interleave(scale, 1)
    width = image.shape[1]
    line = line or max(18, round(width / 40))
    columns = 2
    rows = -(-len(entries) // columns)
    paper = Image.new("RGB", (width, rows * line + 2 * GAP), PAPER)
    draw, font = ImageDraw.Draw(paper), ImageFont.load_default(round(0.7 * line))
    for k, (colour, text) in enumerate(entries):
        left, top = GAP + k // rows * (width // columns), GAP + k % rows * line
        fill = tuple(round(255 * part) for part in colour)
        draw.rectangle((left, top + 2, left + line - 6, top + line - 4), fill=fill, outline=SOFT)
        draw.text((left + line + 2, top), text, fill=INK, font=font)
    below = torch.from_numpy(np.asarray(paper).copy()).float() / 255
    return torch.cat([image.detach().cpu(), below])


def difference_map(difference: Float[Tensor, "H W 3"], full: float) -> Float[Tensor, "H W 3"]:
    """A signed difference as display values: warm where it is brighter, cool where darker, by its mean.

    `full`: what shows at full strength.
    """
    share = (difference.mean(-1, keepdim=True) / max(full, 1e-30)).clamp(-1, 1)
    towards = torch.where(share > 0, difference.new_tensor(WARM), difference.new_tensor(COOL))
    return torch.lerp(torch.full_like(difference, NEUTRAL), towards, share.abs().sqrt())
