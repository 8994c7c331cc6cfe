"""Several sets of episodes as one."""

from __future__ import annotations

import os
from collections.abc import Sequence

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.recordings.episodes.episode_set import SAME_HZ, EpisodeSet, check_agreement
from embodiedreamer_gym.recordings.episodes.load import open_episodes


class JoinedEpisodes(EpisodeSet):
    """The episodes of several sets, one set after the other, named `<set>/<episode>`; nothing is copied.

    names: of the sets, numbers where None; cameras: those that are used, all where None; the sets must agree in them.
    Raises: RecordingError without a set, or where they differ in cameras, sizes or rate.
    """

    def __init__(
        self, sets: Sequence[EpisodeSet], names: Sequence[str] | None = None, cameras: Sequence[str] | None = None
    ) -> None:
        if not sets:
            raise RecordingError("there are no episodes to join; give at least one set")
        labels = [str(number) for number in range(len(sets))] if names is None else list(names)
        if len(labels) != len(sets) or len(set(labels)) != len(sets):
            raise RecordingError(f"{len(sets)} sets of episodes need as many different names, not {labels}")
        first, self._sets = sets[0], tuple(sets)
        wanted = first.cameras if cameras is None else tuple(cameras)
        for one in sets:
            _agree(first, one, wanted, strict=cameras is None)
        same = all(one.objects == first.objects for one in sets)
        super().__init__(
            " and ".join(one.source for one in sets),
            [f"{label}/{name}" for label, one in zip(labels, sets, strict=True) for name in one.names],
            [episode for one in sets for episode in one.episodes], first.state_size, first.action_size,
            {camera: first.frame_size(camera) for camera in wanted}, objects=first.objects if same else None,
        )  # fmt: skip

    @property
    def hz(self) -> float:
        """Steps per second, Hz.

        Raises: RecordingError where a set does not state it, or they differ.
        """
        rates = [one.hz for one in self._sets]
        if max(rates) - min(rates) > SAME_HZ * rates[0]:
            text = ", ".join(f"{one.source} {hz:.4g} Hz" for one, hz in zip(self._sets, rates, strict=True))
            raise RecordingError(f"the sets run at different rates, {text}; join sets of one rate")
        return rates[0]


@renamed_arguments(rate="hz")
def mixed(
    *sets: EpisodeSet | str | os.PathLike[str], hz: float | None = None, cameras: Sequence[str] | None = None
) -> EpisodeSet:
    """Several sets of episodes, or folders of such, as one: recorded and generated ones, for example.

    hz: control rate, Hz, of HDF5 files that do not state it; cameras: as of `JoinedEpisodes`.
    Raises: RecordingError where one cannot be opened, or they do not fit together.
    """
    opened = [one if isinstance(one, EpisodeSet) else open_episodes(one, hz) for one in sets]
    return opened[0] if len(opened) == 1 and cameras is None else JoinedEpisodes(opened, cameras=cameras)


def _agree(first: EpisodeSet, other: EpisodeSet, cameras: tuple[str, ...], strict: bool) -> None:
    """Raise where two sets cannot be one."""
    rule = "sets that are joined must agree"
    check_agreement(first.source, other.source, (
        ("an action size of", first.action_size, other.action_size),
        ("a state size of", first.state_size, other.state_size),
    ), rule)  # fmt: skip
    missing = [camera for camera in cameras if camera not in other.cameras]
    if missing or (strict and set(cameras) != set(other.cameras)):
        raise RecordingError(
            f"{other.source} has the cameras {', '.join(other.cameras) or 'none'}, but needed are "
            f"{', '.join(cameras) or 'none'}; name those that all sets have"
        )
    for camera in cameras:
        a, b = ("{} x {}".format(*one.frame_size(camera)) for one in (first, other))
        check_agreement(first.source, other.source, [("frames of", f"{a} of {camera}", f"{b} of {camera}")], rule)
