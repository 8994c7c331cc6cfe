"""Record demonstrations of a task by its scripted expert, and read them. (ten seconds)"""

from __future__ import annotations

from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
from embodiedreamer_gym.recordings.episodes import open_episodes


def main() -> None:
    wanted = Demonstrations("GrabPaperCup", seed=0, size=(64, 48))  # robot="my_arm_calibrated.json"
    failed = record_demonstrations(wanted, 2, "demos")  # embodiedreamer demos --task GrabPaperCup-v0 ...

    episodes = open_episodes("demos")  # or a folder of your robot's HDF5 files, or a LeRobot v3 folder
    print(f"{episodes!r}; {failed} attempts failed")
    for number, name in enumerate(episodes.names):
        states, actions = episodes.states(number), episodes.actions(number)
        window = episodes.frames(number, "head", 10, 14)  # only these are read
        print(
            f"{name}: '{episodes.task(number)}', states {states.shape}, actions {actions.shape}, frames {window.shape}"
        )


if __name__ == "__main__":
    main()
