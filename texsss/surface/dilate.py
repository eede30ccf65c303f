"""Images of an atlas filled to the full square, for filters and mip maps that look past the gutter."""

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from texsss.errors import ShapeError
from texsss.types import Bool, Float


def dilate(
    image: Float[torch.Tensor, "H W C"], filled: Bool[torch.Tensor, "H W"]
) -> Float[torch.Tensor, "H W C"]:
    """`image` with every empty texel given the value of the nearest filled one.

    `filled` says which texels hold values; those stay as they are. Without any the image comes back as it is.
    Differentiable in `image`. Raises ShapeError: when the two have different sizes.
    Source: exact Euclidean distance transform (Maurer et al. 2003).
    """
    if image.shape[:2] != filled.shape:
        raise ShapeError(
            f"dilate: expected filled to be {tuple(image.shape[:2])} like the image, got {tuple(filled.shape)}; "
            "pass the coverage of this image."
        )
    known = filled.cpu().numpy()
    if known.all() or not known.any():
        return image.clone()
    row, column = distance_transform_edt(~known, return_distances=False, return_indices=True)
    empty = np.flatnonzero(~known)
    source = (row.astype(np.int64) * known.shape[1] + column).reshape(-1)[empty]
    flat = image.reshape(-1, image.shape[-1])
    values = flat[torch.from_numpy(source).to(image.device)]
    return flat.index_copy(0, torch.from_numpy(empty).to(image.device), values).reshape(image.shape)
