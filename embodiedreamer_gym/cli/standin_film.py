"""`embodiedreamer standin film`."""

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.option("--task", "TASK", "task names, or all (default: all)", ["all"], nargs="+"),
    o.option("--episodes", "N", "episodes per task", 1, o.COUNT),
    o.option("--appearance", "A", "lab, many (a random one per episode), or the seed of a random one", "lab"),
    o.SIZE,
    o.out_folder("output folder of TASK_000.hdf5, ...; existing files are kept"),
    o.SEED,
    o.option(
        "--frames", "F", "maximum number of images per episode, from a random start (default: all)", None, o.COUNT
    ),
    o.option("--every", "K", "control steps per image", 1, o.COUNT),
    o.option("--samples", "N", "light paths per pixel", 4, o.COUNT),
    o.option("--camera", "NAME", "cameras: head, left_wrist, right_wrist", ["head"], nargs="+"),
    o.option("--blender", "PYTHON", "interpreter with bpy (default: this one, else $EMBODIEDREAMER_BLENDER)"),
    o.SHARD,
    o.ALL_JOBS,
    o.QUIET,
)
def run(a, progress):
    """Render episodes of the tasks with a path tracer (Blender's Cycles), together with the simulator's frames."""
    from embodiedreamer_gym.envs.tasks import TASKS
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.standin.film.run import film_episodes
    from embodiedreamer_gym.standin.film.settings import FilmSettings

    tasks = list(TASKS) if a.task == ["all"] else [name.removesuffix("-v0") for name in a.task]
    more = (a.appearance, read_size(a.size), a.seed, a.frames, a.every, a.samples, tuple(a.camera))
    films = [FilmSettings(task, *more) for task in dict.fromkeys(tasks)]
    paths = film_episodes(films, a.episodes, a.out, a.jobs, a.blender, progress, shard=a.shard)
    return f"{len(paths)} episodes in {a.out}"
