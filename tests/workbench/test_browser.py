"""The workbench as a browser shows it: the demo from the first look to an accepted model, tabs, saved pages, a killed server."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="viser is not installed")
pytest.importorskip("playwright", reason="playwright is not installed")

import cv2

from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.diagnosis import compare
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.workbench.page import Page
from embodiedreamer_gym.workbench.session import Session
from tests.chromium import needs_chromium
from tests.workbench.browser import Tab, browser, until

EFFECT = "stribeck_friction"
HAVE_IT, OTHERS = ("joint1", "joint2", "joint3"), ("joint4", "joint5", "joint6")
LOST = "The workbench does not answer."

pytestmark = [
    needs_chromium,
    pytest.mark.slow(first=True),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def chromium():
    with browser() as one:
        yield one


@pytest.fixture
def page(tmp_path):
    parts = [load_recordings(DATA / part) for part in ("train", "test")]
    page = Page(Session(RobotModel.load(DATA / "model.json"), *parts, tmp_path / "better.json"), port=0)
    yield page
    page.close()


def test_the_demo_from_the_first_look_to_a_saved_page(page, chromium, tmp_path) -> None:
    session, actions, player = page.session, page.actions, page.motion.player
    tab = Tab(chromium, page.url)
    tab.ready()
    tab.see("7.96 mrad")
    tab.press("play")
    until(lambda: player.seconds > 0.2)
    tab.press("pause")
    until(lambda: not player.playing)
    tab.drag("time [s]", 0.5)
    until(lambda: abs(player.seconds - 0.5 * player.duration) < 0.1)
    ghost, errs = tab.arms(tmp_path / "nominal.png")
    assert ghost > 1000 and errs > 3000

    tab.press("fit")
    tab.see("2.88 mrad")
    tab.press("keep")
    tab.choose("effect", EFFECT)
    tab.see("Stick-slip")
    tab.open("joints")
    for joint in OTHERS:
        tab.check(joint)
    until(lambda: session.state.joints == HAVE_IT)
    tab.drag("sliding", 0.27)
    until(lambda: session.error < 2e-3)
    tab.press("fit")
    tab.see("0.611 mrad")
    assert session.error == compare(session.model, session.test).error[0]
    _, small = tab.arms(tmp_path / "fitted.png")
    assert small < 0.1 * errs

    tab.press("undo")
    until(lambda: session.error > 1e-3)
    tab.press("redo")
    tab.see("0.611 mrad")
    tab.tab("Diagnose")
    tab.press("diagnose")
    until(lambda: actions.status and actions.status.text != "starting")
    tab.press("stop")
    tab.see("diagnose: stopped; nothing has changed.")
    assert session.diagnosis is None
    tab.press("diagnose")
    tab.see(f"Missing: {EFFECT} on {', '.join(HAVE_IT)}.", 300.0)
    tab.press("show the diagnosed model")
    until(lambda: session.state.steps[-1].label == f"+ {EFFECT}")
    tab.press("accept: write better.json")
    tab.see("better.history.json")
    accepted = RobotModel.load(tmp_path / "better.json")
    assert compare(accepted, session.test).error[0] == pytest.approx(0.611e-3, rel=0.02)

    other = Tab(chromium, page.url)  # a second tab sees the same
    other.ready()
    other.see(f"+ {EFFECT}".replace("_", " "))
    tab.page.close()
    other.tab("Where it fails")
    other.press("fast", 1)
    until(lambda: session.log[-1].get("regime") == "fast" and session.joint == "joint2")
    other.tab("Share")
    other.press("save as workbench_report/index.html")
    other.see("scene.html beside it")
    page.close()
    other.see(LOST)
    assert [error for error in other.errors if "WebSocket" not in error] == []
    other.page.close()

    for name in ("index.html", "scene.html"):
        shown = chromium.new_page(viewport={"width": 900, "height": 700})
        asked: list[str] = []
        shown.on("request", lambda request, asked=asked: asked.append(request.url))
        shown.goto((tmp_path / "workbench_report" / name).as_uri())
        shown.wait_for_timeout(4000)
        shown.screenshot(path=str(tmp_path / f"{name}.png"))
        assert cv2.imread(str(tmp_path / f"{name}.png")).std() > 8
        assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
        shown.close()


def start(out: Path, port: str) -> tuple[subprocess.Popen, str]:
    """The command in a process of its own, and the page's address."""
    command = [
        sys.executable,
        "-m",
        "embodiedreamer_gym",
        "workbench",
        "--no-browser",
        "--out",
        str(out),
        "--port",
        port,
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout
    with process.stdout as first:
        return process, first.readline().split()[1]


def test_a_killed_server_is_said_and_a_new_one_works(chromium, tmp_path) -> None:
    out = tmp_path / "better.json"
    process, url = start(out, "8190")
    tab = Tab(chromium, url)
    tab.ready()
    tab.press("fit")
    tab.see("2.88 mrad")
    tab.tab("Diagnose")
    tab.press("accept: write better.json")
    tab.see("better.history.json")
    assert LOST not in tab.text()
    process.send_signal(signal.SIGKILL)
    process.wait()
    tab.see(LOST)
    assert len(RobotModel.load(out).joints) == 6

    process, again = start(out, url.rsplit(":", 1)[1])
    assert again == url
    tab.page.reload()
    tab.ready()
    tab.tab("Diagnose")
    tab.press("accept: write better-2.json")
    tab.see("better-2.history.json")
    assert (tmp_path / "better-2.json").is_file()
    process.terminate()
    process.wait()
    tab.page.close()
