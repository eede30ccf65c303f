"""What every mesh reader hands back, before units, merging and checks."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from texsss.errors import AssetError, TooLarge

MAX_FACES = 10_000_000
MAX_VERTICES = 30_000_000


@dataclass
class RawMesh:
    """Triangles as the file has them.

    `vertices` (V, 3) and `uv` (F, 3, 2), v down, are float64, `faces` (F, 3) int64. `notes` are
    sentences for the user. `v_runs`: which way v was taken to run in the file.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None
    notes: list[str] = field(default_factory=list)
    v_runs: Literal["up", "down"] = "up"


class Fault(Exception):
    """What is wrong with a file and what to do, to be completed by the file's name."""

    def __init__(self, fault: str, remedy: str = "export it again", *, counts: tuple[int, int] | None = None):
        super().__init__(fault)
        self.fault, self.remedy = fault, remedy
        self.counts = counts  # how many may be and are, where that is the fault

    def named(self, name: str) -> AssetError:
        """The error for the user."""
        sentence = f"{name}: {self.fault}; {self.remedy}."
        return AssetError(sentence) if self.counts is None else TooLarge(sentence, *self.counts)


def check_counts(vertices: int, faces: int) -> None:
    """Raises Fault when a file asks for more than a mesh of this size could need."""
    if vertices > MAX_VERTICES or faces > MAX_FACES:
        raise Fault(
            f"expected at most {MAX_FACES:,} triangles and {MAX_VERTICES:,} vertices, "
            f"got {faces:,} and {vertices:,}",
            "decimate the mesh",
            counts=(MAX_FACES, faces) if faces > MAX_FACES else (MAX_VERTICES, vertices),
        )


def check_indices(faces: np.ndarray, vertices: int, *, counted_from: int = 0) -> None:
    """Raises Fault when a face refers to a vertex that the file does not have."""
    if faces.size and (faces.min() < 0 or faces.max() >= vertices):
        wrong = int(faces.max()) if faces.max() >= vertices else int(faces.min())
        wrong += counted_from
        raise Fault(f"a face refers to vertex {wrong} of {vertices}", "the file is damaged, export it again")
