"""Depth-buffer rasterizer: part and depth of the nearest triangle in each cell of a grid."""

from __future__ import annotations

import numba as nb
import numpy as np

NEAREST = 0.02  # m, near plane
jit = nb.njit(cache=True, nogil=True, error_model="numpy")


@jit
def draw(points, faces, part, height, width, code, depth):
    """Draw T pictures at once into code (T, height, width), part + 1 or 0, and depth (T, height, width), m.

    points (T, V, 3): column and row in cells (the middle of the first is 0, 0), depth in m; faces (F, 3); part (V,).
    Triangles that cross the near plane are skipped.
    """
    for t in range(points.shape[0]):
        for f in range(faces.shape[0]):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            za, zb, zc = points[t, a, 2], points[t, b, 2], points[t, c, 2]
            if za < NEAREST or zb < NEAREST or zc < NEAREST:
                continue
            xa, ya = points[t, a, 0], points[t, a, 1]
            xb, yb = points[t, b, 0], points[t, b, 1]
            xc, yc = points[t, c, 0], points[t, c, 1]
            left, right = min(xa, xb, xc), max(xa, xb, xc)
            top, bottom = min(ya, yb, yc), max(ya, yb, yc)
            if right < 0.0 or bottom < 0.0 or left > width - 1 or top > height - 1:
                continue
            area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
            if area == 0.0:
                continue
            i0, i1 = max(0, int(np.ceil(left))), min(width - 1, int(np.floor(right)))
            j0, j1 = max(0, int(np.ceil(top))), min(height - 1, int(np.floor(bottom)))
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    u = ((xb - i) * (yc - j) - (xc - i) * (yb - j)) / area
                    v = ((xc - i) * (ya - j) - (xa - i) * (yc - j)) / area
                    w = 1.0 - u - v
                    if u < 0.0 or v < 0.0 or w < 0.0:
                        continue
                    z = 1.0 / (u / za + v / zb + w / zc)
                    if code[t, j, i] == 0 or z < depth[t, j, i]:
                        code[t, j, i] = part[a] + 1
                        depth[t, j, i] = z


def draw_parts(
    points: np.ndarray, faces: np.ndarray, part: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Rasterize T pictures; returns part + 1, uint8, 0 where nothing is (T, H, W), and depth, m, else 0 (T, H, W).

    points: vertices (T, V, 3), column and row in cells, depth in m.
    faces: vertex numbers (F, 3).
    part: of each vertex (V,).
    size: width and height of the grid.
    """
    code = np.zeros((len(points), size[1], size[0]), np.uint8)
    depth = np.zeros(code.shape, np.float32)
    draw(np.ascontiguousarray(points, np.float32), faces, part, size[1], size[0], code, depth)
    return code, depth
