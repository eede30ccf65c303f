"""Images of an atlas filled to the full square, for filters and mip maps that look past the gutter."""

import numpy as np
import torch

from texsss.errors import ShapeError
from texsss.types import Bool, Float, Int, Tensor


def dilate(
    image: Float[Tensor, "H W C"], filled: Bool[Tensor, "H W"], nearest: Int[Tensor, "H W"] | None = None
) -> Float[Tensor, "H W C"]:
    """`image` with every empty texel given the value of the nearest filled one.

    `filled` says which texels hold values; those stay as they are. Without any the image comes back as it is.
    `nearest`: `nearest_filled(filled)`, to spare the search when several images share a coverage.
    Differentiable in `image`. Raises ShapeError: when the two have different sizes.
    """
    if image.shape[:2] != filled.shape:
        raise ShapeError(
            f"dilate: expected filled to be {tuple(image.shape[:2])} as the image, "
            f"got {tuple(filled.shape)}; pass the coverage of this image."
        )
    if nearest is None:
        nearest = nearest_filled(filled)
    return image.reshape(-1, image.shape[-1]).index_select(0, nearest.reshape(-1)).reshape(image.shape)


def nearest_filled(filled: Bool[Tensor, "H W"]) -> Int[Tensor, "H W"]:
    """Row-major index of the filled texel nearest to each texel; each texel's own if none is filled.

    Source: exact Euclidean distance transform (Maurer et al. 2003).
    """
    from scipy.ndimage import distance_transform_edt  # slow to import, and few stages fill

    known = filled.cpu().numpy()
    height, width = known.shape
    if known.all() or not known.any():
        own = np.arange(height * width).reshape(height, width)
        return torch.from_numpy(own).to(filled.device)
    row, column = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return torch.from_numpy(row.astype(np.int64) * width + column).to(filled.device)
