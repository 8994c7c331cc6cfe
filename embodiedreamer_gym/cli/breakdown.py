"""`embodiedreamer breakdown`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model


@o.verb(o.RECORDINGS, o.MODEL, *o.LOGS)
def run(a, progress):
    """Show a model's error by joint, regime and side (controller or plant)."""
    from embodiedreamer_gym.diagnosis import error_breakdown

    model = load_model(a, a.model)
    breakdown = error_breakdown(model, load_logs(a, model, a.recordings))
    return o.Result(breakdown, report={"breakdown": breakdown})
