"""Key poses learnt from demonstrations, each in the frame in which the demonstrations agree best."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.policies.key_pose.arms import Arms
from embodiedreamer_gym.policies.key_pose.cutting import KeyInstant, cut
from embodiedreamer_gym.policies.key_pose.frames import (
    Scene,
    folded,
    frames,
    into,
    middle,
    mirrored,
    outof,
    spread,
    thing,
)

Array = np.ndarray
FEWEST = 3  # demonstrations with the same sequence of key poses
ARRAYS = ("positions", "rotations", "posture")  # of a key pose
NUMBERS = ("opening", "before", "after", "speed", "spread")  # of a key pose
LARGEST, SLOWEST = 1000.0, 1e-4  # largest of these numbers; lowest speed, m/s
TURN = 0.1  # m: what a rad of an object's direction counts as in the distance between scenes


@dataclass(frozen=True)
class Demonstration:
    """One episode: states (T, n), actions (T, n), control rate (Hz), and the objects on the table at its start."""

    states: Array
    actions: Array
    hz: float
    scene: Scene


@dataclass(frozen=True)
class Key:
    """A key pose in each demonstration, in its frame.

    frame: its name; positions (D, 3), rotations (D, 3, 3); event: whether the gripper changes there; opening: of the
    gripper from there on; before, after: s of rest before and after the change; speed: mean speed of the end effector
    on the way to it, m/s; spread: see `frames.spread`; posture (m,): median angles of the arm there, rad.
    """

    frame: str
    positions: Array
    rotations: Array
    event: bool
    opening: float
    before: float
    after: float
    speed: float
    spread: float
    posture: Array


@dataclass(frozen=True)
class Skill:
    """Key poses of a task, learnt from D demonstrations with the same sequence of key poses.

    keys: in the order of the task; scenes: of the demonstrations, mirrored if the second arm acted; side: the object
    whose side decides which arm acts; opening: of the gripper at the start.
    """

    keys: tuple[Key, ...]
    scenes: tuple[dict[str, tuple[float, float, float]], ...]
    side: str
    opening: float

    def poses(self, scene: Scene, base: Array, demonstration: int | None = None, flip: bool = False) -> list[Pose]:
        """Poses of the end effector in a scene: the middle of all demonstrations, or those of one.

        flip: whether the object that is gripped first is gripped the other way round.
        """
        gripped = next((thing(key.frame) for key in self.keys if key.event), None) if flip else None
        at, found = frames(scene, base, gripped), []
        for key in self.keys:
            if demonstration is None:
                one = middle(key.positions, key.rotations)
            else:
                one = key.positions[demonstration], key.rotations[demonstration]
            found.append(Pose.of(*outof(at[key.frame], *one)))
        return found

    def nearest(self, scene: Scene) -> list[int]:
        """Numbers of the demonstrations, the one with the most similar scene first."""

        def away(other: Scene) -> float:
            return sum(
                float(np.hypot(x - other[name][0], y - other[name][1])) + TURN * abs(folded(angle - other[name][2]))
                for name, (x, y, angle) in scene.items()
            )

        return sorted(range(len(self.scenes)), key=lambda d: away(self.scenes[d]))

    def as_dict(self) -> dict[str, Any]:
        """The skill as a JSON-serialisable dictionary."""
        keys = [
            {**{name: getattr(key, name) for name in ("frame", "event", *NUMBERS)},
             **{name: getattr(key, name).tolist() for name in ARRAYS}}
            for key in self.keys
        ]  # fmt: skip
        return {"keys": keys, "scenes": [dict(one) for one in self.scenes], "side": self.side, "opening": self.opening}

    @staticmethod
    def of(data: dict[str, Any]) -> Skill:
        """The inverse of `as_dict`. Raises: PolicyError for anything else."""
        try:
            keys = tuple(_key_of(one) for one in data["keys"])
            scenes = tuple({name: tuple(map(float, one)) for name, one in scene.items()} for scene in data["scenes"])
            count = len(scenes)
            good = keys and all(k.positions.shape == (count, 3) and k.rotations.shape == (count, 3, 3) for k in keys)
            skill = Skill(keys, scenes, str(data["side"]), float(data["opening"]))  # pyright: ignore[reportArgumentType]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise PolicyError(f"invalid key poses: {error!r}.") from error
        if not good:
            raise PolicyError("invalid key poses: the numbers of demonstrations differ.")
        skill._check()
        return skill

    def _check(self) -> None:
        """Check the values.

        Raises: PolicyError for numbers, rotations, frames or scenes that no training writes.
        """
        things = set(self.scenes[0]) if self.scenes else set[str]()
        whole = all(set(scene) == things and all(len(one) == 3 for one in scene.values()) for scene in self.scenes)
        if not things or not whole:
            raise PolicyError("invalid key poses: the scenes must have the same objects, each with x, y and an angle.")
        places = np.array([list(scene.values()) for scene in self.scenes])
        for number, key in enumerate(self.keys):
            arrays = [places, *(np.asarray(getattr(key, name), float) for name in (*NUMBERS, *ARRAYS))]
            turned = np.abs(np.linalg.det(key.rotations) - 1.0).max() < 1e-3
            if not turned or any((np.abs(one) <= LARGEST).sum() < one.size for one in arrays):
                raise PolicyError(f"invalid key poses: key pose {number} has values out of range.")
            if {thing(key.frame), self.side} - things or key.posture.ndim != 1 or key.speed < SLOWEST:
                raise PolicyError(f"invalid key poses: key pose {number} has an unknown frame, posture or speed.")

    def __str__(self) -> str:
        lines = [f"{len(self.scenes)} demonstrations; the arm on the side of the {self.side} acts"]
        lines += [f"{number}. {'gripper ' if key.event else ''}in the frame {key.frame}, spread {1e3 * key.spread:.1f} mm"
                  for number, key in enumerate(self.keys, 1)]  # fmt: skip
        return "\n".join(lines)


def _key_of(data: Mapping[str, Any]) -> Key:
    """A key pose from JSON. Raises: KeyError, TypeError or ValueError for anything else."""
    numbers: dict[str, Any] = {name: float(data[name]) for name in NUMBERS}
    arrays: dict[str, Any] = {name: np.array(data[name], float) for name in ARRAYS}
    return Key(frame=str(data["frame"]), event=bool(data["event"]), **numbers, **arrays)


def learn(demonstrations: Sequence[Demonstration], arms: Arms) -> Skill:
    """Learn key poses from demonstrations; those whose sequence of key poses is not the most common are left out.

    Raises: PolicyError if fewer than three are left, or there is no object on the table.
    """
    if not demonstrations or not all(one.scene for one in demonstrations):
        raise PolicyError("key poses need demonstrations with objects on the table.")
    sides = [arms.acting(one.states) for one in demonstrations]
    cuts = [_cut(one, side, arms) for one, side in zip(demonstrations, sides, strict=True)]
    forms = Counter(tuple(key.event for key in keys) for keys in cuts)
    form, count = forms.most_common(1)[0]
    if count < FEWEST or not any(form):
        raise PolicyError(
            f"only {count} of {len(cuts)} demonstrations have the same sequence of key poses with a change of the gripper; "
            f"at least {FEWEST} are needed."
        )
    chosen = [k for k, keys in enumerate(cuts) if tuple(key.event for key in keys) == form]
    scenes = [dict(demonstrations[k].scene) if sides[k] == 0 else mirrored(demonstrations[k].scene) for k in chosen]
    rows = [[cuts[k][i] for k in chosen] for i in range(len(form))]
    starts = [[0] * len(chosen), *([key.departure for key in row] for row in rows[:-1])]
    hz = [demonstrations[k].hz for k in chosen]
    bent = [_own(demonstrations[k].states, sides[k], arms)[:, arms.arm.joints].astype(float) for k in chosen]
    keys = tuple(_key(row, bent, scenes, start, hz, arms) for row, start in zip(rows, starts, strict=True))
    first = [float(_own(demonstrations[k].actions, sides[k], arms)[0, arms.gripper]) for k in chosen]
    return Skill(keys, tuple(scenes), _side(demonstrations, sides), float(np.median(first)))


def _own(values: Array, side: int, arms: Arms) -> Array:
    return values if side == 0 else arms.mirrored(values)


def _cut(one: Demonstration, side: int, arms: Arms) -> list[KeyInstant]:
    states, actions = (_own(x, side, arms) for x in (one.states, one.actions))
    return cut(states[:, arms.arm.joints], actions[:, arms.gripper], one.hz)


def _key(row: Sequence[KeyInstant], bent: Sequence[Array], scenes: Sequence[Scene], starts: Sequence[int], hz: Sequence[float],
         arms: Arms) -> Key:  # fmt: skip
    """One key pose, in the frame in which the demonstrations agree best."""
    poses = [arms.arm.pose(angles[instant.step]) for angles, instant in zip(bent, row, strict=True)]
    placed = [frames(scene, arms.arm.base) for scene in scenes]
    best: tuple[float, str, Array, Array] | None = None
    for name in placed[0]:
        inside = [into(at[name], *pose) for at, pose in zip(placed, poses, strict=True)]
        positions, rotations = (np.array([one[i] for one in inside]) for i in (0, 1))
        wide = spread(positions, rotations)
        best = (wide, name, positions, rotations) if best is None or wide < best[0] else best
    if best is None:
        raise PolicyError("there is no frame to express key poses in.")
    ends = [
        [arms.arm.pose(angles[k])[0] for k in (a, i.arrival)] for angles, a, i in zip(bent, starts, row, strict=True)
    ]
    way = [float(np.linalg.norm(end - start)) for start, end in ends]
    seconds = [max(i.arrival - a, 1) / f for a, i, f in zip(starts, row, hz, strict=True)]
    before = [(i.step - i.arrival) / f for i, f in zip(row, hz, strict=True)]
    after = [(i.departure - i.step) / f for i, f in zip(row, hz, strict=True)]
    speed = max(float(np.median(np.divide(way, seconds))), SLOWEST)
    opening = float(np.median([i.opening for i in row]))
    wide, name, positions, rotations = best
    posture = np.median([angles[i.step] for angles, i in zip(bent, row, strict=True)], axis=0)
    rest = float(np.median(before)), float(np.median(after))
    return Key(name, positions, rotations, row[0].event, opening, *rest, speed, wide, posture)


def _side(demonstrations: Sequence[Demonstration], sides: Sequence[int]) -> str:
    """The object that is most often on the side of the acting arm."""
    names = list(demonstrations[0].scene)
    agree = [
        np.mean([(d.scene[name][1] < 0) == bool(s) for d, s in zip(demonstrations, sides, strict=True)])
        for name in names
    ]
    return names[int(np.argmax(agree))]
