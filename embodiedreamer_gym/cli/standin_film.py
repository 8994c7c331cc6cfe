"""`embodiedreamer standin film`."""

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.option("--task", "TASK", "names, or all", ["all"], nargs="+"),
    o.option("--episodes", "N", "of each task", 1, o.COUNT),
    o.option("--appearance", "A", "lab, many (another one per episode), or a number that draws one", "lab"),
    o.SIZE,
    o.out_folder("TASK_000.hdf5, ...; existing ones are kept"),
    o.SEED,
    o.option("--frames", "F", "at most so many pictures, from a random start (default: all)", None, o.COUNT),
    o.option("--every", "K", "control steps per picture", 1, o.COUNT),
    o.option("--samples", "N", "light paths per pixel", 4, o.COUNT),
    o.option("--blender", "PYTHON", "interpreter with bpy (default: this one, else $EMBODIEDREAMER_BLENDER)"),
    o.SHARD,
    o.ALL_JOBS,
    o.QUIET,
)
def run(a, progress):
    """Render episodes of the tasks with a path tracer (Blender's Cycles), with the simulator's frames beside them."""
    from embodiedreamer_gym.envs.tasks import TASKS
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.standin.film.run import film_episodes
    from embodiedreamer_gym.standin.film.settings import FilmSettings

    tasks = list(TASKS) if a.task == ["all"] else [name.removesuffix("-v0") for name in a.task]
    more = (a.appearance, read_size(a.size), a.seed, a.frames, a.every, a.samples)
    films = [FilmSettings(task, *more) for task in dict.fromkeys(tasks)]
    paths = film_episodes(films, a.episodes, a.out, a.jobs, a.blender, progress, shard=a.shard)
    return f"{len(paths)} episodes in {a.out}"
