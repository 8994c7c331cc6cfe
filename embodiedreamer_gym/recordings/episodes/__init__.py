"""Episodes with frames: what policies learn from, read and written in the formats of ALOHA, AgileX and LeRobot."""

from embodiedreamer_gym.recordings.episodes.aloha_writer import AlohaWriter, write_aloha_episode
from embodiedreamer_gym.recordings.episodes.concat import JoinedEpisodes, mixed
from embodiedreamer_gym.recordings.episodes.convert import copy_episodes, frames_of
from embodiedreamer_gym.recordings.episodes.episode_set import EpisodeSet
from embodiedreamer_gym.recordings.episodes.lerobot_writer import LeRobotWriter
from embodiedreamer_gym.recordings.episodes.load import open_episodes

__all__ = [
    "AlohaWriter",
    "EpisodeSet",
    "JoinedEpisodes",
    "LeRobotWriter",
    "copy_episodes",
    "frames_of",
    "mixed",
    "open_episodes",
    "write_aloha_episode",
]
