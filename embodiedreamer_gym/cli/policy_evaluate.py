"""`embodiedreamer policy evaluate`."""

from dataclasses import fields
from pathlib import Path

from embodiedreamer_gym.cli.options import (
    BANK,
    COUNT,
    EXECUTE,
    JOBS,
    JSON,
    QUIET,
    REQUIRED,
    ROBOT,
    TASK,
    VIS_ALIGNER,
    option,
    real,
    whole,
)  # fmt: skip
from embodiedreamer_gym.io.files import check_outputs, write_json
from embodiedreamer_gym.pipelines import FRAME_INTERVAL

TEXT = "play a policy on seeds it has not seen: success with its 95-percent interval, one row for each episode"
OPTIONS = (
    option("--policy", "P", "a folder (of `policy train`, or LeRobot's ACT), or package.module:function", REQUIRED),
    TASK,
    option("--episodes", "N", "to play", 50, COUNT),
    option("--seed", "S", "of the first one", 100_000, whole(0, 2**32 - 1)),
    EXECUTE,
    option("--ensemble", "K", "temporal ensembling; the paper's k is 0.01", None, real(-1e3, 1e3)),
    ROBOT,
    option("--size", "WxH", "of the pictures (default: as the policy learnt, or 128x96)"),
    VIS_ALIGNER,
    BANK,
    option("--every", "N", "show the video model's picture after every N-th action and the last of a chunk"
           f" (default {FRAME_INTERVAL}; with --video 1)", None, COUNT),
    JOBS,
    JSON,
    option("--video", "DIR", "write what the cameras saw, a video for each episode", None, Path),
    QUIET,
)  # fmt: skip


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.pipelines.policy_runs import Run, play

    check_outputs(a.json, folders=[a.video])
    evaluation = play(Run(**{field.name: getattr(a, field.name) for field in fields(Run)}), progress)
    progress.close()
    print(evaluation)
    if a.json is not None:
        origin = {"policy": str(a.policy), "robot": str(a.robot), "vis_aligner": a.vis_aligner}
        write_json({**origin, **evaluation.as_dict()}, a.json)
