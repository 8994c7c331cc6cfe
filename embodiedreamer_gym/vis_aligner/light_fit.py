"""Fits the light of a bench to photos: alternately point lights on a dome, and the table without shadows."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.optimize import nnls

from embodiedreamer_gym.vis_aligner.condition import ROBOT, TABLE, Condition
from embodiedreamer_gym.vis_aligner.light import DARKEST, GAMMA, SOFT, Light, incidence
from embodiedreamer_gym.vis_aligner.shadows import Plane, hulls_before_camera, intrinsics, lit_pixels, pixel_rays

RADIUS = 2.2  # m: of the dome over the middle of the table
RINGS = ((15, 16), (30, 16), (45, 16), (58, 12), (70, 10), (80, 6), (90, 1))  # degrees of elevation, lights
SPLIT, ASIDE, AROUND, NEAR_AND_FAR = 14, 0.10, 6, (1.7, 2.6)  # lights to split; radius, number, distances (m)
LOWEST = 0.12  # sine of a light's smallest elevation above the table
MOST_LIGHTS, KEPT = 20, 0.75  # lights kept in the end, share kept in each step
ROUNDS = 5  # of fitting the lights and the table in turn
RIDGE = 1e-3  # of the normal equations' mean diagonal
SHARE = 0.3  # of the pixels, drawn for the fit
WIDEST = 128  # pixels: width of the pictures that are fitted
BRIGHTEST = 1.5  # times the table without shadows: brighter pixels are reflections
FEWEST = 8  # photos
HELD_OUT = 4  # one of this many photos is held out
GAIN = 0.95  # largest ratio of held-out errors, with the light and with the median, at which the light is used


def fit_light(frames: Sequence[np.ndarray], views: Sequence[Condition]) -> Light | None:
    """The light in photos (H, W, 3) uint8 of one bench by one camera; views: of one frame each, with hulls.

    None if there are fewer than eight such photos, or if the light predicts held-out photos no better than the median
    of the others does.
    """
    usable = [i for i, view in enumerate(views) if view.hulls is not None and (view.classes == TABLE).any()]
    if len(usable) < FEWEST:
        return None
    views = [views[i] for i in usable]
    photos = _Photos([frames[i] for i in usable], views)
    positions = _dome(photos.middle, photos.plane.normal)
    lit = photos.lit(positions)
    strengths, _ = photos.fit(positions, lit)
    more = _split(positions[_strongest(photos.power(positions, strengths), SPLIT)], photos.middle, photos.plane.normal)
    positions, lit = np.concatenate([positions, more]), np.concatenate([lit, photos.lit(more)], axis=1)
    while True:  # each light costs time in every frame, so the weakest are dropped in steps, with a new fit each
        strengths, _ = photos.fit(positions, lit)
        power = photos.power(positions, strengths)
        if (power > 0).sum() <= MOST_LIGHTS:
            break
        best = _strongest(power, max(MOST_LIGHTS, int(KEPT * (power > 0).sum())))
        positions, lit = positions[best], lit[:, best]
    if photos.error(positions, lit) > GAIN:
        return None
    used = strengths > 0
    receivers = np.any([view.classes[0] == TABLE for view in views], axis=0)
    return Light(positions[used], strengths[used], photos.plane, receivers, photos.matrix)


class _Photos:
    """Photos as used in the fit: small, and in linear light.

    light (N, h, w) float32; table (N, h, w) bool: where the table is seen; matrix, scaled (3, 3): the camera's
    intrinsics for the photos and for the small ones.
    """

    def __init__(self, frames: Sequence[np.ndarray], views: Sequence[Condition]) -> None:
        self._views, self.matrix = views, intrinsics(np.asarray(views[0].projections))
        width, height = views[0].size
        share = min(1.0, WIDEST / width)
        self.size = round(share * width), round(share * height)
        x, y = self.size[0] / width, self.size[1] / height
        half = np.array([[x, 0, 0.5 * x - 0.5], [0, y, 0.5 * y - 0.5], [0, 0, 1.0]])
        self.scaled = half @ self.matrix
        tables = [_table(view).astype(np.uint8) for view in views]
        self.table = np.stack([cv2.resize(t, self.size, interpolation=cv2.INTER_NEAREST) > 0 for t in tables])
        small = [cv2.resize(frame, self.size, interpolation=cv2.INTER_AREA) for frame in frames]
        self.light = np.stack([((s / 255.0) ** GAMMA).mean(axis=2) for s in small]).astype(np.float32)
        self.plane = _table_plane(views, self.matrix)
        seen = self.table.any(axis=0)
        self.middle = np.median(self.plane.seen(self.scaled, self.size)[0][seen], axis=0)

    def lit(self, positions: np.ndarray) -> np.ndarray:
        """Share (N, M, h, w) uint8, of 255, of each light that reaches the table in each photo."""
        soft = SOFT * self.size[0]
        rows = []
        for view in self._views:
            points = hulls_before_camera(view, self.matrix)
            masks = lit_pixels(points, positions, self.plane, self.scaled, self.size)
            rows.append([np.round(255 * cv2.GaussianBlur(mask[0], (0, 0), soft)).astype(np.uint8) for mask in masks])
        return np.array(rows)

    def power(self, positions: np.ndarray, strengths: np.ndarray) -> np.ndarray:
        """Mean light (M,) of each point light on the table."""
        return strengths * incidence(positions, self.plane, self.scaled, self.size)[:, self.table.any(axis=0)].mean(
            axis=1
        )

    def fit(
        self, positions: np.ndarray, lit: np.ndarray, photos: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Strengths (M,) and the table without shadows (h, w), fitted in turn; photos (N,) bool: those used."""
        some = np.arange(len(lit)) if photos is None else np.flatnonzero(photos)
        reach = incidence(positions, self.plane, self.scaled, self.size)
        reach /= reach.mean(axis=0)
        bare, strengths = self._over(some, self.light[some], 0.8), np.ones(len(positions))
        for turn in range(ROUNDS):
            normal, right = np.zeros((len(positions),) * 2), np.zeros(len(positions))
            for i in some:
                ratio = self.light[i] / np.maximum(bare, 1e-3)
                chosen = self.table[i] & (ratio < BRIGHTEST) & (bare > 0)
                chosen &= np.random.default_rng([turn, int(i)]).random(chosen.shape) < SHARE
                rows = lit[i][:, chosen] / np.float32(255) * reach[:, chosen]
                normal += rows @ rows.T
                right += rows @ ratio[chosen]
            factor = np.linalg.cholesky(normal + RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal)))
            strengths, _ = nnls(factor.T, np.linalg.solve(factor, right), maxiter=5000)
            reach /= np.maximum(np.tensordot(strengths, reach, 1), 1e-6).astype(np.float32)
            bare = self._over(some, self.light[some] / self._shade(strengths, lit[some], reach), 0.5)
        return strengths, bare

    def error(self, positions: np.ndarray, lit: np.ndarray) -> float:
        """Ratio of errors on the table in held-out photos: with the light, to with the median of the other photos."""
        held = np.arange(len(lit)) % HELD_OUT == HELD_OUT - 1
        strengths, bare = self.fit(positions, lit, ~held)
        reach = incidence(positions, self.plane, self.scaled, self.size)
        reach /= np.maximum(np.tensordot(strengths, reach, 1), 1e-9).astype(np.float32)
        median = self._over(np.flatnonzero(~held), self.light[~held], 0.5)
        chosen = self.table[held] & (median > 0)
        true = self.light[held] ** (1 / GAMMA)
        errors = [np.mean((made ** (1 / GAMMA) - true)[chosen] ** 2)
                  for made in (bare * self._shade(strengths, lit[held], reach), np.broadcast_to(median, true.shape))]  # fmt: skip
        return float(np.sqrt(errors[0] / max(errors[1], 1e-12)))

    def _shade(self, strengths: np.ndarray, lit: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Share (N, h, w) of the light that reaches the table."""
        share = strengths[:, None, None].astype(np.float32) * reach / np.float32(255)
        return np.maximum([np.einsum("mhw,mhw->hw", one, share) for one in lit], DARKEST)

    def _over(self, photos: np.ndarray, light: np.ndarray, quantile: float) -> np.ndarray:
        """Quantile (h, w) over photos of the light on the table; 0 where no photo shows the table."""
        table = self.table[photos]
        ordered = np.sort(np.where(table, light, np.inf), axis=0)  # nanquantile takes ten times as long
        place = np.maximum(quantile * (table.sum(axis=0) - 1), 0).astype(int)
        return np.where(table.any(axis=0), np.take_along_axis(ordered, place[None], axis=0)[0], 0.0).astype(np.float32)


def _table(view: Condition) -> np.ndarray:
    """Pixels (H, W) that show the table and are not at the edge of a thing."""
    things = cv2.dilate((view.classes[0] >= ROBOT).astype(np.uint8), np.ones((3, 3), np.uint8))
    return (view.classes[0] == TABLE) & (things == 0)


def _table_plane(views: Sequence[Condition], matrix: np.ndarray) -> Plane:
    """The plane of the table's points, by least squares; the camera is above it."""
    rays = pixel_rays(matrix, views[0].size)
    points = np.concatenate([(rays * np.asarray(v.depth)[0][..., None])[v.classes[0] == TABLE] for v in views])
    middle = points.mean(axis=0)
    normal = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]
    normal = normal if normal @ middle < 0 else -normal
    return Plane(normal, float(normal @ middle))


def _dome(middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Lights (M, 3) on a dome over the table."""
    across = np.cross(normal, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    along = np.cross(across, normal)
    found = []
    for degrees, count in RINGS:
        up = np.radians(degrees)
        for angle in 2 * np.pi * (np.arange(count) + 0.5 * (degrees % 2)) / count:
            aside = np.cos(angle) * along + np.sin(angle) * across
            found.append(middle + RADIUS * (np.cos(up) * aside + np.sin(up) * normal))
    return np.array(found)


def _split(lights: np.ndarray, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Lights in directions around those of given lights, nearer and farther than the dome."""
    found = []
    for light in lights:
        towards = (light - middle) / np.linalg.norm(light - middle)
        one = np.cross(towards, normal if abs(towards @ normal) < 0.9 else (1.0, 0.0, 0.0))
        one /= np.linalg.norm(one)
        two = np.cross(towards, one)
        for angle in 2 * np.pi * np.arange(AROUND) / AROUND:
            aside = towards + ASIDE * (np.cos(angle) * one + np.sin(angle) * two)
            aside /= np.linalg.norm(aside)
            found += [middle + distance * aside for distance in NEAR_AND_FAR if aside @ normal > LOWEST]
    return np.array(found)


def _strongest(power: np.ndarray, count: int) -> np.ndarray:
    """Numbers, in order, of the strongest lights with a power above 0."""
    return np.sort(np.argsort(-power, kind="stable")[: min(count, int((power > 0).sum()))])
