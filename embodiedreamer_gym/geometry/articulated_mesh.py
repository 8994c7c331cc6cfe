"""Articulated meshes: rigid parts, each a mesh in its own frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.errors import VisionError

MOST_PARTS = 254
PLAIN = 200  # triangles up to which a part is never made coarser, because a box would vanish


@dataclass(frozen=True, eq=False)
class Body:
    """Triangles of P rigid parts of a robot.

    vertices (V, 3): m, in the frame of the vertex's part; faces (F, 3): vertex numbers, each face of one part; part
    (V,): part number of each vertex; names: of the P parts. Raises: VisionError where these are inconsistent.
    """

    vertices: np.ndarray
    faces: np.ndarray
    part: np.ndarray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        for field, kind in (("vertices", np.float32), ("faces", np.int32), ("part", np.int32)):
            value = np.array(getattr(self, field), kind)
            value.setflags(write=False)
            object.__setattr__(self, field, value)
        object.__setattr__(self, "names", tuple(self.names))
        v, f, p = self.vertices, self.faces, self.part
        if v.ndim != 2 or v.shape[1] != 3 or f.ndim != 2 or f.shape[1] != 3 or p.shape != v.shape[:1]:
            raise VisionError(
                f"a body needs vertices (V, 3), faces (F, 3) and part (V,), not {v.shape}, {f.shape} and {p.shape}."
            )
        if not len(f) or not np.isfinite(v).all():
            raise VisionError("a body needs at least one triangle, and finite vertices.")
        if f.min() < 0 or f.max() >= len(v) or p.min() < 0 or p.max() >= len(self.names):
            raise VisionError("a body's faces must contain indices of its vertices, and part indices of its parts.")
        if len(self.names) > MOST_PARTS:
            raise VisionError(f"a body of {len(self.names)} parts has too many; at most {MOST_PARTS} are allowed.")

    def __repr__(self) -> str:
        return f"Body({len(self.names)} parts, {len(self.faces)} triangles)"

    def at(self, poses: np.ndarray) -> np.ndarray:
        """Positions of the vertices (T, V, 3), m, single precision, for poses (T, P, 4, 4) of the parts.

        Raises: VisionError when the poses have another number of parts.
        """
        poses = np.asarray(poses, np.float32)
        if poses.ndim != 4 or poses.shape[1:] != (len(self.names), 4, 4):
            raise VisionError(f"poses must be (T, {len(self.names)}, 4, 4), one 4x4 per part, not {poses.shape}.")
        placed = np.empty((len(poses), len(self.vertices), 3), np.float32)
        for k in range(len(self.names)):
            own = self.part == k
            placed[:, own] = self.vertices[own] @ poses[:, k, :3, :3].transpose(0, 2, 1) + poses[:, None, k, :3, 3]
        return placed

    def chosen(self, names: Iterable[str]) -> np.ndarray:
        """Which parts (P,), bool, have one of these names.

        Raises: VisionError for an unknown name.
        """
        wanted = set(names)
        unknown = wanted - set(self.names)
        if unknown:
            raise VisionError(f"the robot has no visible link '{min(unknown)}'; it has {', '.join(self.names)}.")
        return np.array([name in wanted for name in self.names], bool)

    def coarser(self, cell: float) -> Body:
        """The body with all vertices in a cube of this width, m, merged; parts with few triangles, like boxes, stay."""
        triangles = np.bincount(self.part[self.faces[:, 0]], minlength=len(self.names))
        fine = (triangles > PLAIN)[self.part]
        cube = np.where(fine[:, None], np.floor(self.vertices / cell).astype(np.int64), 0)
        own = np.where(fine, -1, np.arange(len(self.vertices)))
        keys = np.column_stack([self.part, own, cube])
        _, first, group, count = np.unique(keys, axis=0, return_index=True, return_inverse=True, return_counts=True)
        group = group.ravel()
        middle = np.zeros((len(first), 3))
        np.add.at(middle, group, self.vertices)
        faces = group[self.faces]
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        single = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
        keep = whole & np.isin(np.arange(len(faces)), single)
        used, kept = np.unique(faces[keep], return_inverse=True)
        if not len(used):
            return self
        return Body((middle / count[:, None])[used], kept.reshape(-1, 3), self.part[first][used], self.names)


@dataclass(frozen=True, eq=False)
class DetailLevels:
    """A body in three levels of detail: coarse for a search, middle for silhouettes, fine for edges.

    loose: parts whose shape may differ in the pictures, such as another gripper (P,), bool.
    margin: distance around them within which edges are ignored, m.
    """

    fine: Body
    middle: Body
    coarse: Body
    loose: np.ndarray
    margin: float

    @staticmethod
    def of(body: Body, reach: float, loose: Iterable[str] = (), margin: float = 0.06) -> DetailLevels:
        """Make the levels for a robot whose moving points are inside a sphere of this radius, m.

        Raises: VisionError for an unknown loose part, or a margin below 0.
        """
        if not 0.0 <= margin < np.inf:
            raise VisionError(f"the margin around loose links is {margin} m, but must be at least 0.")
        fine = body.coarser(reach / 60.0)
        return DetailLevels(
            fine, fine.coarser(reach / 30.0), fine.coarser(reach / 15.0), body.chosen(loose), float(margin)
        )
