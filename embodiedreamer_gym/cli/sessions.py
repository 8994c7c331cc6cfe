"""`embodiedreamer sessions`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model
from embodiedreamer_gym.errors import RecordingError


@o.verb(
    o.option("sessions", "SESSION", "files, folders or quoted globs, one for each session; the first is the reference",
             o.REQUIRED, nargs="+"),
    o.MODEL,
    o.option("--effect", "NAMES", "additional effects to fit, such as payload"),
    *o.FIT,
    *(one for one in o.LOGS if one.name != "--report"),
)  # fmt: skip
def run(a, progress):
    """Compare recordings of different days, loads or robots: which parameters differ."""
    from embodiedreamer_gym.diagnosis.sessions import compare_sessions

    model = load_model(a, a.model)
    for name in (a.effect or "").split(","):
        model = model.with_effect(name.strip()) if name.strip() else model
    names = [Path(text).stem if a.sessions.count(text) == 1 else text for text in a.sessions]
    if len(set(names)) < len(names):
        names = a.sessions
    if len(set(names)) < len(names):
        raise RecordingError("a session is given twice; give different recordings.")
    sessions = {name: load_logs(a, model, [text], fit=True) for name, text in zip(names, a.sessions, strict=True)}
    return o.Result(compare_sessions(model, sessions, progress))
