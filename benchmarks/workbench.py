"""The workbench in a browser: start, drags, agreement with `compare`, and thousands of random actions.

python -m benchmarks workbench [--starts 3] [--drags 50] [--actions 2000] [--seed 11] [--out FILE.json]

Needs viser, playwright and Chromium. Start-up time is from the start of the command in a new process until the arm is
drawn; drag time is from the pointer's movement to the changed error in the page; the random actions are shown in an
open tab. CPU seconds are those of the server's process only, without the browser, which renders without a graphics
card.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil

from benchmarks.common import pin_threads, save, times
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.diagnosis import compare
from embodiedreamer_gym.io.tables import milli
from embodiedreamer_gym.recordings import Recording, load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import aloha_case
from embodiedreamer_gym.workbench.page import Page
from embodiedreamer_gym.workbench.session import Session
from tests.workbench.browser import Tab, browser
from tests.workbench.random_actions import random_actions

EFFECT, GROUP = "stribeck_friction", "stribeck_friction.sliding"
DRAWN = 8.0  # standard deviation of the picture, of 255, above which it shows the arm
MOST = 120_000  # ms to wait for a picture
SETTLED = 300  # actions after which memory is measured for the first time
LATE = "Tried to update non-existent component"  # viser: a slider was moved and removed between two updates; harmless
LATENCY = """() => {
  const errors = () => [...document.querySelectorAll('b')].map(b => b.textContent).filter(t => t.endsWith('mrad')).join();
  window.last = errors(); window.moved = window.drawn = 0;
  document.addEventListener('pointermove', () => { window.moved = performance.now(); }, true);
  new MutationObserver(() => { if (errors() !== window.last) { window.last = errors(); window.drawn = performance.now(); } })
    .observe(document.body, {subtree: true, childList: true, characterData: true});
}"""
Logs = tuple[RobotModel, Sequence[Recording], Sequence[Recording]]


def demo() -> Logs:
    """The demo's arm: six joints, two held-out recordings of 4 s at 100 Hz."""
    return RobotModel.load(DATA / "model.json"), load_recordings(DATA / "train"), load_recordings(DATA / "test")


def pair(seed: int) -> Logs:
    """The ALOHA pair: 14 joints, two held-out episodes of 10 s at 30 Hz."""
    with tempfile.TemporaryDirectory() as folder:
        path = aloha_case(EFFECT, "left", np.random.default_rng(seed), episodes=4).write(folder)
        train, test = (load_recordings(f"{folder}/{part}", hz=30.0) for part in ("train", "test"))
        return RobotModel.load(path), list(train), list(test)


@contextmanager
def shown(chromium: Any, logs: Logs) -> Iterator[tuple[Page, Tab]]:
    """Serve a page with these logs, and open it in a tab."""
    with tempfile.TemporaryDirectory() as folder:
        page = Page(Session(*logs, f"{folder}/better.json"), port=0)
        try:
            tab = Tab(chromium, page.url)
            tab.ready()
            yield page, tab
            tab.page.close()
        finally:
            page.close()


def start(chromium: Any) -> dict[str, float]:
    """Seconds from the command to the page's address and to the drawn arm; CPU seconds of server and browser."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "embodiedreamer_gym",
            "workbench",
            "--no-browser",
            "--out",
            f"{folder}/better.json",
        ]
        browsers = psutil.Process().children(recursive=True)
        before, begun = _cpu(browsers), time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert process.stdout
            url = process.stdout.readline().split()[1]
            served = time.perf_counter() - begun
            tab = chromium.new_page(viewport={"width": 1440, "height": 900})
            tab.set_default_timeout(MOST)
            tab.goto(url)
            tab.wait_for_selector("canvas")
            while _picture(tab)[:, 440:1000].std() < DRAWN:
                time.sleep(0.1)
            drawn, used = time.perf_counter() - begun, _cpu([psutil.Process(process.pid)])
            others = [p for p in psutil.Process().children(recursive=True) if p.pid != process.pid]
            drew = _cpu(others) - before
            tab.close()
        finally:
            process.terminate()
            process.wait()
    return {"served_s": served, "picture_s": drawn, "cpu_s": used, "browser_cpu_s": drew}


def _cpu(processes: Sequence[psutil.Process]) -> float:
    return sum(sum(process.cpu_times()[:2]) for process in processes)


def _picture(tab: Any) -> np.ndarray:
    picture = cv2.imdecode(np.frombuffer(tab.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture


def drags(chromium: Any, logs: Logs, count: int) -> dict[str, float]:
    """Milliseconds from a slider's movement to the redrawn error, and the largest difference to errors of `compare`."""
    with shown(chromium, logs) as (page, tab):
        tab.choose("effect", EFFECT)
        tab.see("slider for")
        page.actions.wait()
        box = tab.track("sliding")
        x, y = box["x"], box["y"] + box["height"] / 2
        tab.page.mouse.move(x + 2, y)
        tab.page.mouse.down()
        tab.page.evaluate(LATENCY)
        took, cpu, apart = [], [], 0.0
        for share in np.random.default_rng(0).permutation(np.linspace(0.15, 0.6, count)):
            used = time.process_time()
            tab.page.mouse.move(x + share * box["width"], y)
            tab.page.wait_for_function("window.drawn > window.moved")
            cpu.append(time.process_time() - used)
            took.append(float(tab.page.evaluate("window.drawn - window.moved")))
            page.actions.wait()
            apart = max(apart, abs(page.session.error - compare(page.session.model, page.session.test).error[0]))
        tab.page.mouse.up()
    return {"median_ms": float(np.median(took)), "least_ms": min(took), "most_ms": max(took),
            "cpu_median_ms": 1e3 * float(np.median(cpu)), "off_compare": float(apart)}  # fmt: skip


class Tracebacks(logging.Handler):
    """Count log records with an exception."""

    count = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Count the record if it has an exception."""
        self.count += record.exc_info is not None


def random_session(chromium: Any, logs: Logs, count: int, seed: int) -> dict[str, Any]:
    """Random actions in an open tab: tracebacks, console errors, memory, and whether a replay gives the same state."""
    tracebacks, process = Tracebacks(), psutil.Process()
    logging.getLogger().addHandler(tracebacks)
    begun, first = time.perf_counter(), 0
    with shown(chromium, logs) as (page, tab):
        for k, (action, given) in enumerate(random_actions(page.session, np.random.default_rng(seed), count)):
            page.actions.do(action, **given)
            while page.actions.waiting > 4:
                time.sleep(0.005)
            if k % 200 == 0:
                tab.page.wait_for_timeout(1.0)  # processes pending browser messages
                print(f"  {k} of {count} actions, {time.perf_counter() - begun:.0f} s", flush=True)
            if k == min(SETTLED, count - 1):
                page.actions.wait()
                first = process.memory_info().rss
        page.actions.wait(300.0)
        grown = process.memory_info().rss - first
        tab.see(milli(page.session.error))
        one, late = page.session, [error for error in tab.errors if error.startswith(LATE)]
        again = Session.replay(one.log, *logs)
        same = repr(again.model.parameters()) == repr(one.model.parameters()) and again.error == one.error
        same = same and (again.joint, again.recording, again.time) == (one.joint, one.recording, one.time)
        same = same and [s.label for s in again.state.steps] == [s.label for s in one.state.steps]
    logging.getLogger().removeHandler(tracebacks)
    return {"actions": count, "done": len(one.log), "tracebacks": tracebacks.count, "console_errors": [error for error in tab.errors if error not in late], "late_updates": len(late),
            "grown_mb": grown / 1e6, "same_as_replayed": same, "seconds": time.perf_counter() - begun}  # fmt: skip


def main() -> None:
    """Print one line for each figure."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--starts", type=times, default=3)
    parser.add_argument("--drags", type=times, default=50)
    parser.add_argument("--actions", type=times, default=2000)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    pin_threads()
    rows: dict[str, Any] = {}
    with browser() as chromium:
        starts = [start(chromium) for _ in range(a.starts)]
        rows["start"] = {key: float(np.median([one[key] for one in starts])) for key in starts[0]}
        print("start: page served after {served_s:.1f} s, arm drawn after {picture_s:.1f} s (target: 5), {cpu_s:.1f} s of CPU, the browser {browser_cpu_s:.1f}".format(
            **rows["start"]), flush=True)  # fmt: skip
        for name, logs, target in (("six joints", demo(), 150), ("ALOHA pair", pair(a.seed), 400)):
            rows[name] = drags(chromium, logs, a.drags)
            line = "{median_ms:.0f} ms median of a drag ({least_ms:.0f} to {most_ms:.0f}; {cpu_median_ms:.0f} ms of CPU; target: {target})"
            print(f"{name}: {line.format(target=target, **rows[name])}; "
                  f"largest difference to compare: {rows[name]['off_compare']:g} rad (target: 0)", flush=True)  # fmt: skip
            save(rows, a.out)
        rows["random"] = random_session(chromium, demo(), a.actions, a.seed)
        line = "{actions} actions: {tracebacks} tracebacks, {grown_mb:.0f} MB grown (target: below 100), same as in Python: {same_as_replayed}"
        print(f"{line.format(**rows['random'])}, errors of the console: {len(rows['random']['console_errors'])}")
    save(rows, a.out)


if __name__ == "__main__":
    main()
