"""`embodiedreamer standin film`."""

from embodiedreamer_gym.cli.options import ALL_JOBS, COUNT, QUIET, SEED, SIZE, option, out_folder
from embodiedreamer_gym.io.files import check_outputs

TEXT = "episodes of the tasks rendered by a path tracer (Blender's Cycles), with the simulator's frames beside them"
OPTIONS = (
    option("--task", "TASK", "names, or all", ["all"], nargs="+"),
    option("--episodes", "N", "of each task", 1, COUNT),
    option(
        "--appearance", "A", "lab: one appearance; many: another one per episode; or a number that draws one", "lab"
    ),
    SIZE,
    out_folder("TASK_000.hdf5, ...; existing ones are kept"),
    SEED,
    option(
        "--frames", "F", "largest number of pictures, from a random start (default: the whole episode)", None, COUNT
    ),
    option("--every", "K", "control steps per picture", 1, COUNT),
    option("--samples", "N", "light paths per pixel", 4, COUNT),
    option(
        "--blender", "PYTHON", "interpreter that has bpy (default: this one if it has, else $EMBODIEDREAMER_BLENDER)"
    ),
    ALL_JOBS,
    QUIET,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.envs.tasks import TASKS
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.standin.film.run import film_episodes
    from embodiedreamer_gym.standin.film.settings import FilmSettings

    check_outputs(folders=[a.out])
    size = read_size(a.size)
    tasks = list(TASKS) if a.task == ["all"] else [name.removesuffix("-v0") for name in a.task]
    films = [
        FilmSettings(task, a.appearance, size, a.seed, a.frames, a.every, a.samples) for task in dict.fromkeys(tasks)
    ]
    paths = film_episodes(films, a.episodes, a.out, a.jobs, a.blender, progress)
    progress.close()
    print(f"{len(paths)} episodes in {a.out}")
