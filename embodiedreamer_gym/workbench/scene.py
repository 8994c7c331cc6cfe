"""Two arms in a viser scene: the measured one, coloured by its error, and the simulated one, a translucent ghost."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.diagnosis.trajectory_error import tip_poses
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.forward_kinematics import EndEffector
from embodiedreamer_gym.robot.surface import Surface

QUIET, SMALL, LARGE = (176, 186, 198), (244, 190, 66), (204, 41, 36)  # error of one, several, many noises
MOST = 20.0  # error in sensor noises at which a link is fully red
SHADES = 24  # number of colours, so that a link's colour is sent only when it changes visibly
GHOST, MEASURED = (31, 111, 178), (60, 64, 72)
MOST_FACES = 120_000
SHRUNK = 0.98  # scale of the ghost's links
TRACE = 400  # most points of a trace


def colour(noises: float) -> tuple[int, int, int]:
    """Colour of a joint for its error in sensor noises: grey up to 2, then amber, red at 20."""
    share = np.clip(np.log(max(noises, 2.0) / 2.0) / np.log(MOST / 2.0), 0.0, 1.0)
    share = np.round(share * SHADES) / SHADES
    first, second, part = (QUIET, SMALL, 2 * share) if share < 0.5 else (SMALL, LARGE, 2 * share - 1)
    mixed = np.array(first) + part * (np.array(second) - np.array(first))
    return tuple(round(float(v)) for v in mixed)  # pyright: ignore[reportReturnType]


class Scene:
    """The robot's scene; `show` places both arms, `trace` draws the paths of the end effectors.

    scene: a viser `SceneApi`.
    """

    def __init__(self, scene: Any, model: RobotModel) -> None:
        self._scene, self._model = scene, model
        self.surface = Surface.of_model(model, skeleton=True)
        body = self.surface.body
        if len(body.faces) > MOST_FACES:
            body = body.coarser(self.size / 150)
        self._movers = [None if name is None else model.joints.index(name) for name in self.surface.movers()]
        self._ends = [EndEffector(model.urdf, link) for link in model.tree.tips]
        self._arms: dict[str, list[Any]] = {}
        self._colours: list[tuple[int, int, int]] = [QUIET] * len(body.names)
        for arm, opacity in (("measured", None), ("simulated", 0.4)):
            scene.add_frame(f"/{arm}", show_axes=False)
            self._arms[arm] = []
            for k, name in enumerate(body.names):
                used, index = np.unique(body.faces[body.part[body.faces[:, 0]] == k], return_inverse=True)
                vertices = body.vertices[used]
                if opacity:  # slightly smaller, so that the ghost shows only where it differs from the measured arm
                    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
                    vertices = middle + SHRUNK * (vertices - middle)
                self._arms[arm].append(scene.add_mesh_simple(
                    f"/{arm}/{k}_{name}", vertices, index.reshape(-1, 3), opacity=opacity, flat_shading=True,
                    color=GHOST if opacity else QUIET, side="double" if opacity is None else "front", cast_shadow=False,
                ))  # fmt: skip
        self._furnish()

    @property
    def size(self) -> float:
        """Largest distance of the arm's points from its middle, at the zero position, m."""
        points = self.surface.points(np.zeros((1, len(self._model.joints))))[0]
        return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())

    def tips(self, positions: np.ndarray) -> np.ndarray:
        """Positions (T, arms, 3) m of the end effectors at joint positions (T, n)."""
        return np.stack([tip_poses(end, self._model, positions)[0] for end in self._ends], axis=1)

    def show(self, measured: np.ndarray, simulated: np.ndarray | None, noises: np.ndarray) -> None:
        """Place the arms at joint positions (n,); noises (n,): current error of each joint in sensor noises."""
        self._place("measured", measured)
        self._arms_visible("simulated", simulated is not None)
        if simulated is not None:
            self._place("simulated", simulated)
            ends = np.concatenate([self.tips(measured[None]), self.tips(simulated[None])]).swapaxes(0, 1)
            self._lines("/between", ends, LARGE, 3.0)
        for k, joint in enumerate(self._movers):
            wanted = QUIET if joint is None else colour(float(noises[joint]))
            if wanted != self._colours[k]:
                self._arms["measured"][k].color = self._colours[k] = wanted

    def trace(self, measured: np.ndarray, simulated: np.ndarray | None) -> None:
        """Draw the end effectors' paths at joint positions (T, n)."""
        for name, positions, colour_, width in (
            ("measured", measured, MEASURED, 2.0),
            ("simulated", simulated, GHOST, 2.0),
        ):
            if positions is None:
                self._scene.remove_by_name(f"/trace/{name}") if self._scene.get_handle_by_name(
                    f"/trace/{name}"
                ) else None
                continue
            rows = np.linspace(0, len(positions) - 1, min(TRACE, len(positions))).astype(int)
            path = self.tips(positions[rows])
            pieces = np.stack([path[:-1], path[1:]], axis=2).reshape(-1, 2, 3)
            self._lines(f"/trace/{name}", pieces, colour_, width)

    def _lines(self, name: str, pieces: np.ndarray, colour_: tuple[int, int, int], width: float) -> None:
        handle = self._scene.get_handle_by_name(name)
        if handle is None:
            self._scene.add_line_segments(name, pieces.astype(np.float32), colour_, line_width=width)
        else:
            handle.points = pieces.astype(np.float32)

    def _place(self, arm: str, positions: np.ndarray) -> None:
        poses = self.surface.poses(positions[None])[0]
        turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
        for handle, turn, place in zip(self._arms[arm], turns, poses[:, :3, 3], strict=True):
            handle.wxyz, handle.position = turn, place

    def _arms_visible(self, arm: str, visible: bool) -> None:
        handle = self._scene.get_handle_by_name(f"/{arm}")
        if handle.visible != visible:
            handle.visible = visible

    def _furnish(self) -> None:
        points = self.surface.points(np.zeros((1, len(self._model.joints))))[0]
        low, middle = float(points[:, 2].min()), points.mean(axis=0)
        self._scene.add_grid("/floor", width=8 * self.size, height=8 * self.size, position=(middle[0], middle[1], low - 0.002),
                             cell_size=self.size / 5, section_size=self.size, cell_color=(225, 228, 232),
                             section_color=(205, 209, 215), shadow_opacity=0.0)  # fmt: skip
