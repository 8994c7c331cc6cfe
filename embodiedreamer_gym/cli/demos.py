"""`embodiedreamer demos`."""

from embodiedreamer_gym.cli.options import ALL_JOBS, COUNT, QUIET, ROBOT, SEED, SIZE, TASK, option, out_folder
from embodiedreamer_gym.io.files import check_outputs

TEXT = "demonstrations of a task by its scripted expert, successes only, for policies to learn from"
FORMATS = ("aloha", "lerobot")
OPTIONS = (
    TASK,
    option("--episodes", "N", "that succeed", 50, COUNT),
    option("--format", None, "HDF5 files or a LeRobot v3 set (default: %(default)s)", "aloha", choices=FORMATS),
    out_folder("goes on where it was"),
    SEED,
    SIZE,
    option("--cameras", "NAMES", "with commas", "head"),
    ROBOT,
    ALL_JOBS,
    QUIET,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.pipelines import demonstrations

    check_outputs(folders=[a.out])
    wanted = demonstrations.Demonstrations(
        task_name(a.task), a.seed, read_size(a.size), tuple(a.cameras.split(",")), a.robot
    )
    record = demonstrations.record_demonstrations if a.format == "aloha" else demonstrations.record_lerobot
    failed = record(wanted, a.episodes, a.out, a.jobs, progress)
    progress.close()
    print(f"{a.episodes} episodes in {a.out}; {failed} attempts failed and were left out")
