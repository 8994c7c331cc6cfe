"""Actions that the page requests, run one by one in a thread; long work runs in a second thread and can be stopped."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.workbench.session import Job, Session

IDLE = 0.25  # s without an action before slow drawings are updated
LOG = logging.getLogger(__name__)


class StoppedError(Exception):
    """The user stopped the long work."""


@dataclass
class Status:
    """Progress of long work; candidates: effect -> held-out error, in the order in which a diagnosis fits them."""

    name: str
    text: str = "starting"
    share: float = 0.0
    candidates: dict[str, str] = field(default_factory=dict)


class Actions:
    """The only thread that modifies a session.

    changed: called after every action; settled: called when no action was requested for IDLE seconds; progressed:
    called as long work advances; say: called with a sentence to show to the user.
    """

    def __init__(
        self, session: Session, changed: Callable[[], None], settled: Callable[[], None],
        progressed: Callable[[], None], say: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.session, self.status = session, None
        self.status: Status | None
        self._changed, self._settled, self._progressed, self._say = changed, settled, progressed, say
        self._queue: queue.Queue[tuple[str, dict[str, Any]] | Callable[[], None] | None] = queue.Queue()
        self._stopping = threading.Event()
        self._idle = threading.Event()
        self._thread = threading.Thread(target=self._run, name="actions", daemon=True)

    @property
    def waiting(self) -> int:
        """Number of actions that are requested but not started."""
        return self._queue.qsize()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def do(self, action: str, **given: Any) -> None:
        """Request an action of the session."""
        self._idle.clear()
        self._queue.put((action, given))

    def call(self, work: Callable[[], None]) -> None:
        """Request other work in the session's thread, such as writing a page."""
        self._idle.clear()
        self._queue.put(work)

    def note(self, text: str) -> None:
        """Show a sentence when the actions requested so far are done."""
        self._queue.put(lambda: self._say(text))

    def attempt(self, work: Callable[[], None]) -> bool:
        """Do some work in this thread and show its error, if any; returns whether it succeeded."""
        try:
            work()
        except EmbodieDreamerError as error:
            self._say(str(error))
        except Exception as error:
            LOG.exception("an action failed")
            self._say(f"That failed: {type(error).__name__}: {error}")
        else:
            return True
        return False

    def stop(self) -> None:
        """Stop the long work, at its next step."""
        self._stopping.set()

    def wait(self, seconds: float = 60.0) -> bool:
        """Wait until all actions are done and drawn; returns False after a timeout."""
        return self._idle.wait(seconds)

    def close(self) -> None:
        """End both threads."""
        self.stop()
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join(5.0)

    def _run(self) -> None:
        unsettled = True
        while True:
            try:
                item = self._queue.get(timeout=IDLE if unsettled else None)
            except queue.Empty:
                self.attempt(self._settled)
                unsettled = False
                if self.session.job is None and self._queue.empty():
                    self._idle.set()
                continue
            if item is None:
                return
            if self._outdated(item):
                continue
            self.attempt(item if callable(item) else lambda item=item: self._act(*item))
            self.attempt(self._changed)
            unsettled = True

    def _outdated(self, item: Any) -> bool:
        """Whether the next waiting action replaces this one: it moves the same slider or clock."""
        if callable(item) or item[0] not in ("set_size", "set_value", "choose_time"):
            return False
        with self._queue.mutex:
            after = self._queue.queue[0] if self._queue.queue else None
        if not isinstance(after, tuple) or after[0] != item[0]:
            return False
        return all(item[1].get(key) == after[1].get(key) for key in ("parameter", "place"))

    def _act(self, action: str, given: dict[str, Any]) -> None:
        if action not in self.session.JOBS:
            self.session.do(action, **given)
            return
        job = self.session.start(action, **given)
        self._stopping.clear()
        self.status = Status(job.name)
        threading.Thread(target=self._work, args=(job,), name=job.name, daemon=True).start()

    def _work(self, job: Job) -> None:
        try:
            result = job.run(self._report)
        except StoppedError:
            self.call(lambda: self._end(f"{job.name}: stopped; nothing has changed."))
        except EmbodieDreamerError as error:
            text = str(error)
            self.call(lambda: self._end(text))
        except Exception as error:
            LOG.exception("%s failed", job.name)
            text = f"{job.name} failed: {type(error).__name__}: {error}"
            self.call(lambda: self._end(text))
        else:
            self.call(lambda: self._take(result))

    def _take(self, result: Any) -> None:
        self.status = None
        self.session.finish(result)

    def _end(self, text: str) -> None:
        self.status = None
        self.session.cancel()
        self._say(text)

    def _report(self, stage: str, done: int, total: int | None = None, /, **quantities: object) -> None:
        """Report progress of the long work, from its thread."""
        status = self.status
        if self._stopping.is_set():
            raise StoppedError
        if status is None:
            return
        if "effect" in quantities and "held_out_error" in quantities:
            status.candidates[str(quantities["effect"])] = str(quantities["held_out_error"])
        steps = f" {done} of {total}" if total else ""
        more = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in quantities.items())
        status.text, status.share = f"{stage}{steps}" + (f": {more}" if more else ""), done / total if total else 0.0
        self._progressed()
