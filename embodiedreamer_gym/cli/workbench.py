"""`embodiedreamer workbench`."""

import itertools
import time
import webbrowser
from pathlib import Path

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model
from embodiedreamer_gym.errors import EmbodieDreamerError


@o.verb(
    o.option("recordings", "REC", f"{o.FILES}; without recordings and --model: a game with the demo's arm", nargs="*"),
    o.option("--model", "M", o.MODELS, None),
    o.option("--test", "REC", "held-out recordings, which give the error (default: every second REC)", [], nargs="+"),
    o.out_file("FILE.json", "model that `accept` writes, with FILE.history.json; FILE-2.json if FILE.json exists (default: better.json)", Path("better.json")),
    o.option("--host", "ADDRESS", "address on which the page is served; addresses other than 127.0.0.1 give"
             " other machines access", "127.0.0.1"),
    o.option("--port", "N", "port of the page, or the next free one", 8080, o.number(int, 1, 65535)),
    o.option("--no-browser", None, "do not open a browser"),
    *o.FIT,
    *o.LOGS[:-2],
)  # fmt: skip
def run(a, progress):
    """Open a page that compares a model with recordings, and lets you try effects."""
    from embodiedreamer_gym.workbench.serve import load_viser

    load_viser()
    if a.model is None and (a.recordings or a.test):
        raise EmbodieDreamerError("recordings need a model: give one with --model.")
    if a.model is not None and not a.recordings:
        raise EmbodieDreamerError("--model needs recordings: give files, folders or quoted globs.")
    from embodiedreamer_gym.workbench.page import Page

    page = Page(*_session(a), host=a.host, port=a.port)
    progress.close()
    only = "only this machine can open it" if a.host == "127.0.0.1" else "other machines may open it"
    print(f"workbench: {page.url} ({only}); Ctrl-C ends it", flush=True)
    if not a.no_browser:
        webbrowser.open(page.url)
    try:
        while True:
            time.sleep(3600.0)
    finally:
        page.close()


def _session(a):
    """The session for the command line, the text at the top of the page, and whether it is the demo game."""
    from embodiedreamer_gym.demo import DATA
    from embodiedreamer_gym.workbench.session import Session

    game = a.model is None
    model = load_model(a, str(DATA / "model.json") if game else a.model)
    train = load_logs(a, model, [str(DATA / "train")] if game else a.recordings, fit=True)
    words = ""
    if game or a.test:
        test = load_logs(a, model, [str(DATA / "test")] if game else a.test, fit=True)
    elif len(train) > 1:
        train, test = train.split()
    else:
        test, words = (
            train,
            "There is only one recording, so the error is that of the fitted motion, not of held-out motion.",
        )
    return Session(model, train, test, _free(a.out), a.jobs, a.seed), words, game


def _free(path):
    """The path; if the file exists, with the first number from 2 on that gives a new file."""
    numbered = (path.with_stem(f"{path.stem}-{k}") for k in itertools.count(2))
    return next(p for p in itertools.chain([path], numbered) if not p.exists())
