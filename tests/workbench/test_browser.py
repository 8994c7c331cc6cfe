"""The workbench as a browser shows it: the error falls as a slider moves, tabs agree, and saved pages open offline."""

from __future__ import annotations

import pytest

pytest.importorskip("viser", reason="viser is not installed")
pytest.importorskip("playwright", reason="playwright is not installed")

import cv2

from embodiedreamer_gym.workbench.page import Page
from embodiedreamer_gym.workbench.session import Session
from tests.chromium import needs_chromium
from tests.two_joint_arm import load_arm, record
from tests.workbench.browser import Tab, browser

EFFECT = "coulomb_friction"

pytestmark = [
    needs_chromium,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture
def page(tmp_path):
    arm = load_arm(tmp_path)
    true = arm.with_effect(EFFECT).with_values({f"{EFFECT}.torque": {"shoulder": 0.6, "elbow": 0.2}})
    logs = [record(true, f"wave_{k}", 5e-4, seed=k) for k in range(4)]
    page = Page(Session(arm, logs[:2], logs[2:], tmp_path / "better.json"), port=0)
    yield page
    page.close()


@pytest.fixture(scope="module")
def chromium():
    with browser() as one:
        yield one


def test_from_the_first_look_to_a_saved_page(page, chromium, tmp_path) -> None:
    session = page.session
    tab = Tab(chromium, page.url)
    tab.ready()
    nominal = session.error
    assert f"{1e3 * nominal:.2f} mrad" in tab.text()
    tab.picture(tmp_path / "motion.png")
    picture = cv2.imread(str(tmp_path / "motion.png"))
    assert picture[:, 440:1030].std() > 8  # the scene
    assert picture[300:480, 60:420].std() > 8  # the chart of the error

    tab.choose("effect", EFFECT)
    tab.see("slider for")
    tab.drag("torque", 0.3)
    assert page.actions.wait() and session.error < 0.8 * nominal
    tab.see(f"{1e3 * session.error:.2f} mrad")
    sizes = [entry["size"] for entry in session.log if entry["action"] == "set_size"]
    assert sizes[-1] == pytest.approx(0.3, abs=0.05)

    tab.press("fit")
    assert page.actions.wait(120)
    tab.see(f"{1e3 * session.error:.3f} mrad")
    tab.press("keep")
    other = Tab(chromium, page.url)  # a second tab sees the same
    other.ready()
    other.see(f"+ {EFFECT}, fitted".replace("_", " "))
    tab.page.close()

    other.tab("Where it fails")
    other.press("fast", 1)
    assert page.actions.wait() and session.joint == "elbow" and session.log[-1]["regime"] == "fast"

    other.tab("Diagnose")
    other.press("accept: write better.json")
    assert page.actions.wait() and session.accepted is not None and session.accepted.is_file()
    other.tab("Share")
    other.press("save as workbench_report/index.html")
    assert page.actions.wait(120)
    assert other.errors == []
    other.page.close()

    for name in ("index.html", "scene.html"):
        shown = chromium.new_page(viewport={"width": 900, "height": 700})
        asked: list[str] = []
        shown.on("request", lambda request, asked=asked: asked.append(request.url))
        shown.goto((session.out.with_name("workbench_report") / name).as_uri())
        shown.wait_for_timeout(4000)
        shown.screenshot(path=str(tmp_path / f"{name}.png"))
        assert cv2.imread(str(tmp_path / f"{name}.png")).std() > 8
        assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def test_a_closed_page_says_so_and_loses_nothing(page, chromium) -> None:
    tab = Tab(chromium, page.url)
    tab.ready()
    tab.tab("Diagnose")
    tab.press("accept: write better.json")
    assert page.actions.wait()
    page.close()
    tab.see("The workbench has ended")
    assert page.session.accepted is not None and page.session.accepted.is_file()
