"""`embodiedreamer standin bank`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o

EVERY = 25  # control steps per picture: few pictures show the robot in many poses


@o.verb(
    o.SIZE,
    o.out_file("FILE.npz", "bank"),
    o.option("--films", "DIR", "folder of the rendered images (default: FILE_films)", None, o.output_folder),
    o.option("--episodes", "N", "episodes per task", 8, o.COUNT),
    o.option(
        "--photo-scale",
        "N",
        "also render the head camera's images N times as large, for sharper photos of robot and objects",
        1,
        o.number(int, 1, 4),
    ),
    o.option("--moving", "NAME", "cameras that move with the robot: left_wrist, right_wrist", [], nargs="+"),
    o.option("--appearance", "A", "lab, or the seed of a random one", "lab"),
    o.SEED,
    o.option("--samples", "N", "light paths per pixel", 4, o.COUNT),
    o.option("--blender", "PYTHON", "interpreter with bpy (default: this one, else $EMBODIEDREAMER_BLENDER)"),
    o.ALL_JOBS,
    o.QUIET,
)
def run(a, progress):
    """Render all tasks on the simulated bench at another image size and make its bank; an interrupted run resumes."""
    from embodiedreamer_gym.cli import vis
    from embodiedreamer_gym.envs.tasks import TASKS
    from embodiedreamer_gym.errors import EmbodieDreamerError
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.standin.film.run import film_episodes
    from embodiedreamer_gym.standin.film.settings import FilmSettings

    if a.appearance == "many":
        raise EmbodieDreamerError(
            "a bank shows one bench; give --appearance lab, or a number that selects a random one."
        )
    folder = a.out.with_name(f"{a.out.stem}_films") if a.films is None else a.films
    size = read_size(a.size)
    large = folder.with_name(f"{folder.name}_{a.photo_scale}x")

    def film(to: Path, scale: int, cameras: tuple[str, ...]) -> None:
        shown = size[0] * scale, size[1] * scale
        films = [FilmSettings(task, a.appearance, shown, a.seed, None, EVERY, a.samples, cameras) for task in TASKS]
        film_episodes(films, a.episodes, to, a.jobs, a.blender, progress)

    film(folder, 1, ("head", *a.moving))
    if a.photo_scale > 1:
        film(large, a.photo_scale, ("head",))
    a.episodes, a.more, a.moving_episodes, a.photos = [folder], [], [], [large] if a.photo_scale > 1 else []
    return vis.bank.run(a, progress)
