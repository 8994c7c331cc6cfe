"""`embodiedreamer add`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_model, load_split


@o.verb(
    o.option("effect", "EFFECT", "name of an effect, from `embodiedreamer effects` or --effects", o.REQUIRED),
    o.MODEL,
    *o.SPLIT,
    o.out_file("FILE.json", "output: model with the effect"),
    *o.FIT,
    *o.LOGS,
)
def run(a, progress):
    """Add an effect to a model and fit again."""
    from embodiedreamer_gym.diagnosis import add_effect

    model = load_model(a, a.model)
    richer = model.with_effect(a.effect)  # reports an unknown effect before any log is read
    added = add_effect(model, a.effect, *load_split(a, richer), progress=progress)
    report = {"calibration": added.after, "comparison": added.comparison}
    return o.Result(added, report=report, model=added.after.model)
