"""The page without a browser: what it shows is the session's, in time, and many random actions leave no trace."""

from __future__ import annotations

import re
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

pytest.importorskip("viser", reason="viser is not installed")

from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.surface import Surface
from embodiedreamer_gym.workbench import html, scene
from embodiedreamer_gym.workbench.page import Page
from embodiedreamer_gym.workbench.serve import serve
from embodiedreamer_gym.workbench.session import Session
from embodiedreamer_gym.workbench.share import scene_page
from tests.two_joint_arm import load_arm, record
from tests.workbench.browser import until
from tests.workbench.random_actions import random_actions
from tests.workbench.test_session import EFFECT

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
DRAG = 0.15  # s from a slider's move to the error that is redrawn
MEMORY = 100e6  # bytes


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    model = load_arm(tmp_path_factory.mktemp("arm"))
    true = model.with_effect(EFFECT).with_values({f"{EFFECT}.torque": {"shoulder": 0.6, "elbow": 0.2}})
    return model, [record(true, f"wave_{k}", 5e-4, seed=k) for k in range(4)]


@pytest.fixture
def page(logs, tmp_path):
    model, recordings = logs
    page = Page(Session(model, recordings[:2], recordings[2:], tmp_path / "better.json"), port=0)
    assert page.actions.wait(60)
    yield page
    page.close()


def shown(page: Page) -> str:
    """All HTML of the page."""
    handles = page.server.gui._gui_input_handle_from_uuid
    inside = [h for panel in page.panels for h in vars(panel).values() if hasattr(h, "content")]
    return "\n".join([str(len(handles)), *(h.content for h in inside)])


def test_the_page_shows_the_error_of_the_session(page) -> None:
    for size in np.linspace(0.0, 0.3, 7):
        page.actions.do("set_effect", name=EFFECT)
        page.actions.do("set_size", parameter=f"{EFFECT}.torque", size=float(size))
    assert page.actions.wait(60)
    comparison = page.session.measure.comparison(page.session.model)
    errors = re.findall(r"<b>([\d.]+) mrad</b>", shown(page))
    assert [float(e) for e in errors] == pytest.approx([1e3 * e for _, e in page.session.staircase], rel=6e-3)
    assert page.session.error == comparison.error[0]
    now = page.motion._error.data[4]
    error = 1e3 * comparison.errors(0)[page.session.test.index(page.session.recording)][:, 0]
    assert np.array_equal(now, error)


def test_what_is_refused_is_said(page) -> None:
    page.actions.do("undo")
    page.actions.do("jump", joint="elbow", regime="asleep")
    assert page.actions.wait(60)
    assert page._said.visible and "there is no regime" in page._said.content


def test_a_jump_moves_the_clock(page) -> None:
    page.motion.player.playing = True
    page.motion.player.refresh()
    page.actions.do("jump", joint="elbow", regime="fast")
    assert page.actions.wait(60)
    assert page.motion.player.seconds == page.session.time > 0.0 and not page.motion.player.playing


def test_the_clock_plays_loops_and_stops(page) -> None:
    player = page.motion.player
    player.speed, player.loop, player.seconds = 50.0, False, 0.0
    player.playing = True
    player.refresh()
    begun = time.monotonic()
    while player.playing and time.monotonic() - begun < 5.0:
        time.sleep(0.02)
    assert not player.playing and player.seconds == player.duration


class Film:
    """Frames of one colour, the sample's number; they cannot be read from sample `broken` on."""

    def __init__(self, length: int, broken: int | None = None) -> None:
        self._length, self._broken = length, broken

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> np.ndarray:
        if self._broken is not None and index >= self._broken:
            raise RecordingError(f"frame {index} of wrist is damaged")
        return np.full((6, 8, 3), index % 256, np.uint8)


def test_camera_frames_are_shown_and_a_damaged_one_is_a_sentence(logs, tmp_path) -> None:
    model, recordings = logs
    filmed = [r.with_(frames={"top": Film(len(r.time)), "wrist": Film(len(r.time), 50)}) for r in recordings]
    page = Page(Session(model, filmed[:2], filmed[2:], tmp_path / "better.json"), port=0)
    top, wrist = (page.motion._images[name] for name in ("top", "wrist"))
    assert page.actions.wait(60)
    assert top.visible and wrist.visible and (top.image == 0).all()
    page.actions.do("choose_time", seconds=1.0)
    assert page.actions.wait(60)
    until(lambda: not wrist.visible)
    assert (top.image == 100).all() and top.visible
    assert page._said.visible and "frame 100 of wrist is damaged" in page._said.content
    page.motion.player.go(0.5)
    until(lambda: (top.image == 50).all())
    page.close()


def test_logs_without_a_command_show_the_error_of_the_effort(logs, tmp_path) -> None:
    model, recordings = logs
    silent = [r.with_(command=None) for r in recordings]
    page = Page(Session(model, silent[:2], silent[2:], tmp_path / "better.json"), port=0)
    page.actions.do("set_effect", name=EFFECT)
    page.actions.do("choose_recording", name=page.session.names[0])
    assert page.actions.wait(60)
    comparison = page.session.measure.comparison(page.session.model)
    assert np.array_equal(page.motion._error.data[4], 1e3 * comparison.errors(0)[0][:, 0])
    assert page.motion._error._handle.axes[1]["label"] == "error [mA]"
    assert page.motion.motion.simulated is None and "have no commands" in page.motion._words.content
    page.close()


def test_what_fails_in_an_environment_is_a_sentence(page, monkeypatch) -> None:
    share = page.share
    monkeypatch.setattr(share, "_is_aloha", lambda: True)
    page.actions.do("accept")  # a model of two joints, which no environment takes
    assert page.actions.wait(60) and share._open.visible
    share._start()
    until(lambda: "the ALOHA environments need 14" in page._said.content and share._open.visible)
    assert not share._close.visible


def test_the_scene_as_a_page_holds_every_part(page) -> None:
    text = scene_page(page.session, page.motion.motion, 5.0)
    assert "__VISER_EMBED_DATA__" in text and len(text) > 500_000


def test_nothing_casts_a_shadow(page) -> None:
    arms = [handle for parts in page.scene._arms.values() for handle in parts]
    floor = page.server.scene.get_handle_by_name("/floor")
    assert arms and not any(handle.cast_shadow for handle in arms) and floor.shadow_opacity == 0.0


def test_an_arm_without_shapes_is_a_skeleton(logs) -> None:
    model, recordings = logs
    surface = Surface.of_model(model, skeleton=True)
    assert set(surface.body.names) == {"base", "upper", "fore", "tip"}
    assert dict(zip(surface.body.names, surface.movers(), strict=True)) == {
        "base": None, "upper": "shoulder", "fore": "elbow", "tip": "elbow"}  # fmt: skip
    assert np.isfinite(surface.points(recordings[0].position[:3])).all()


@pytest.mark.parametrize(
    ("noises", "expected"), [(0.0, scene.QUIET), (2.0, scene.QUIET), (20.0, scene.LARGE), (1e9, scene.LARGE)]
)
def test_colours_begin_at_the_noise(noises: float, expected: tuple[int, int, int]) -> None:
    assert scene.colour(noises) == expected


def test_names_of_files_are_no_html() -> None:
    text = (
        html.bars([("<script>x</script>", 1e-3)], 1e-3, "rad") + html.table(("<b>",), [["<i>"]]) + html.sentence("<u>")
    )
    assert "<script>" not in text and "<i>" not in text and "<u>" not in text


def test_an_address_that_is_not_this_machines_is_a_sentence() -> None:
    with pytest.raises(EmbodieDreamerError, match=r"no page can be served at 203\.0\.113\.1"):
        serve("203.0.113.1", 8080)


def test_no_tunnel_is_offered(page) -> None:
    handlers = page.server._websock_server._incoming_handlers
    assert not any(kind.__name__ == "ShareUrlRequest" for kind in handlers)


@pytest.mark.parametrize(
    ("words", "expected"),
    [(["no.csv"], "recordings need a model"), (["--model", "aloha"], "--model needs recordings"),
     (["--model", "no.json", "no.csv"], "model no.json is neither")],
)  # fmt: skip
def test_what_is_missing_is_one_sentence(words, expected, capsys) -> None:
    from embodiedreamer_gym.cli.command import main

    assert main(["workbench", "--no-browser", *words]) == 2
    assert expected in capsys.readouterr().err


def test_a_file_that_exists_gets_a_sister(tmp_path) -> None:
    from embodiedreamer_gym.cli.workbench import _free

    assert _free(tmp_path / "better.json").name == "better.json"
    for name, expected in (("better.json", "better-2.json"), ("better-2.json", "better-3.json")):
        (tmp_path / name).touch()
        assert _free(tmp_path / "better.json").name == expected


def test_without_viser_one_sentence_names_the_command() -> None:
    code = "import sys; sys.modules['viser'] = None\nfrom embodiedreamer_gym.cli.command import main\nsys.exit(main(['workbench']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    assert "pip install 'embodiedreamer-gym[workbench]'" in done.stderr and "Traceback" not in done.stderr


def test_the_first_picture_waits_for_no_library_of_later_ones() -> None:
    code = "import sys, embodiedreamer_gym.workbench.page\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "embodiedreamer_gym.workbench.page" in loaded
    assert not {"matplotlib", "mujoco", "torch", "scipy.signal", "scipy.stats", "jinja2"} & set(loaded)


@pytest.mark.slow
def test_a_drag_is_redrawn_in_time(tmp_path) -> None:
    model, train, test = (
        RobotModel.load(DATA / "model.json"),
        load_recordings(DATA / "train"),
        load_recordings(DATA / "test"),
    )
    page = Page(Session(model, train, test, tmp_path / "better.json"), port=0)
    page.actions.do("set_effect", name="stribeck_friction")
    assert page.actions.wait(120)
    took = []
    for size in np.linspace(0.05, 0.4, 20):
        begun = time.perf_counter()
        page.session.do("set_size", parameter="stribeck_friction.sliding", size=float(size))
        page.update()
        took.append(time.perf_counter() - begun)
    page.close()
    print(f"median {1e3 * np.median(took):.0f} ms, least {1e3 * min(took):.0f} ms")
    assert min(took) < DRAG


@pytest.mark.release
def test_random_actions(page, logs, caplog) -> None:
    """Two thousand in `python -m benchmarks workbench`."""
    model, recordings = logs
    process = psutil.Process()
    begun = 0
    for k, (action, given) in enumerate(random_actions(page.session, np.random.default_rng(11), 500)):
        page.actions.do(action, **given)
        while page.actions.waiting > 4:
            time.sleep(0.005)
        if k == 200:
            assert page.actions.wait(60)
            begun = process.memory_info().rss
    assert page.actions.wait(120)
    assert caplog.records == []  # an exception that is no sentence is logged
    assert process.memory_info().rss - begun < MEMORY
    again = Session.replay(page.session.log, model, recordings[:2], recordings[2:])
    assert repr(again.model.parameters()) == repr(page.session.model.parameters())
    assert (again.joint, again.recording, again.time) == (page.session.joint, page.session.recording, page.session.time)
    assert again.error == page.session.error
