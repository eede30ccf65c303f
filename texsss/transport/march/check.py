"""What a march is asked for, checked before it starts: each fault in one sentence."""

from collections.abc import Sequence
from typing import Any

import torch

from texsss.errors import DomainError, ShapeError
from texsss.surface.mesh import Mesh
from texsss.transport.march.planes import Planes
from texsss.types import Tensor

MOST_SAMPLES = 10_000
UNIT = 1e-3  # by which lengths of unit vectors may be off


def check_method(method: str, samples: Any, phase: str, environment_samples: int, area_samples: int) -> None:
    """Raises DomainError for what cannot be marched."""
    if method not in ("exact", "uniform"):
        raise DomainError(f"march: expected method 'exact' or 'uniform', got {method!r}.")
    if phase not in ("henyey-greenstein", "schlick"):
        raise DomainError(f"march: expected phase 'henyey-greenstein' or 'schlick', got {phase!r}.")
    if not (isinstance(samples, int) and 1 <= samples <= MOST_SAMPLES):
        raise DomainError(
            f"march: expected 1 to {MOST_SAMPLES} samples, got {samples!r}; 4 exact ones are plenty."
        )
    if min(environment_samples, area_samples) < 1:
        raise DomainError(
            f"march: expected at least 1 sample per light, got {environment_samples} and {area_samples}; "
            "16 serve well."
        )


def check_planes(mesh: Mesh, planes: Planes | None) -> None:
    """Raises ShapeError for planes of another mesh."""
    if planes is not None and len(planes.offset) != len(mesh.vertices):
        raise ShapeError(
            f"march: expected a plane for each of {len(mesh.vertices):,} vertices, got "
            f"{len(planes.offset):,}; fit them to this mesh, or pass None."
        )


def check_view(points: int, view: Tensor) -> None:
    """Raises ShapeError or DomainError for views that do not fit the points."""
    if view.shape not in ((3,), (points, 3)):
        raise ShapeError(
            f"march: expected the position of one eye (3,) or a view direction per point ({points}, 3), got "
            f"shape {tuple(view.shape)} for {points} points."
        )
    seen = view.detach()
    if not bool(torch.isfinite(seen).all()):
        raise DomainError("march: expected a finite eye or view directions, got NaN or infinity.")
    if seen.ndim == 2 and points:
        least, most = torch.linalg.vector_norm(seen, dim=1).aminmax()
        if least < 1 - UNIT or most > 1 + UNIT:
            raise DomainError(
                f"march: expected unit view directions, got lengths from {float(least):g} to "
                f"{float(most):g}; divide them by their lengths, or pass the position of the eye."
            )


def check_points(points: int, thickness: Tensor | None, normals: Tensor | None) -> None:
    """Raises ShapeError or DomainError for what does not fit the points."""
    for name, given, shape in (("thickness", thickness, (points,)), ("normals", normals, (points, 3))):
        if given is None:
            continue
        if given.shape != shape:
            raise ShapeError(
                f"march: expected {name} of shape {shape}, got {tuple(given.shape)}; give a row per point."
            )
        if bool(torch.isnan(given.detach()).any()):
            raise DomainError(f"march: expected numbers as {name}, got NaN; check what made them.")


def check_entered(points: int, lights: int, entered: Sequence[Tensor | None] | None) -> None:
    """Raises ShapeError for light that does not fit the points or the lights."""
    if entered is None:
        return
    if len(entered) != lights:
        raise ShapeError(
            f"march: expected what entered of each of {lights} lights, got {len(entered)}; give None "
            "for those that are to be sampled."
        )
    for known in entered:
        if known is not None and known.shape != (points, 3):
            raise ShapeError(
                f"march: expected what entered as {(points, 3)}, got shape {tuple(known.shape)}; give a row "
                "per point."
            )
