"""`embodiedreamer demos`."""

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.TASK,
    o.option("--episodes", "N", "number of successful episodes", 50, o.COUNT),
    o.option("--format", None, "ALOHA HDF5 files or a LeRobot v3 dataset", "aloha", choices=("aloha", "lerobot")),
    o.out_folder("output folder; an interrupted run resumes"),
    o.SEED,
    o.SIZE,
    o.option("--cameras", "NAMES", "camera names, separated by commas", "head"),
    o.ROBOT,
    o.option(
        "--retarget",
        "DIR",
        "recorded episodes whose key poses are retargeted to new scenes, instead of the scripted expert",
    ),
    o.ALL_JOBS,
    o.QUIET,
)
def run(a, progress):
    """Record successful demonstrations of a task's scripted expert, or retarget recorded ones, to train policies."""
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.pipelines import demonstrations

    size, cameras = read_size(a.size), tuple(a.cameras.split(","))
    wanted = demonstrations.Demonstrations(task_name(a.task), a.seed, size, cameras, a.robot, a.retarget)
    record = demonstrations.record_demonstrations if a.format == "aloha" else demonstrations.record_lerobot
    failed = record(wanted, a.episodes, a.out, a.jobs, progress)
    return f"{a.episodes} episodes in {a.out}; {failed} attempts failed and were left out"
