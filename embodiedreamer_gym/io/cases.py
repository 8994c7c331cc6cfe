"""Long work as a list of cases: finished ones are lines of a file, and several jobs can share the rest."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any

from embodiedreamer_gym.errors import EmbodieDreamerError, brief
from embodiedreamer_gym.io.files import check_regular
from embodiedreamer_gym.io.parallel import each, ended_workers
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.io.results import run_stamp
from embodiedreamer_gym.io.shard import Shard

try:
    import fcntl
except ImportError:  # Windows, where two processes that write to one file are not detected
    fcntl = None

Row = dict[str, Any]
Work = Callable[[dict[str, Any]], Mapping[str, Any]]
WHOLE = Shard()


def key_of(description: Mapping[str, Any]) -> str:
    """SHA-256 of a description, written as JSON with sorted keys and without spaces."""
    text = json.dumps(description, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class Cases:
    """A list of cases; the result of each depends only on its description.

    A case's description is `settings` plus the fields of one item of `each`; its key is the SHA-256 of that. A row is a
    description plus the result of the case: one line of JSON in a file of rows, in any order.
    """

    settings: Mapping[str, Any]
    """Fields that all cases share; JSON-serialisable."""
    each: Sequence[Mapping[str, Any]]
    """Fields that distinguish the cases: the same names in each; JSON-serialisable."""

    @cached_property
    def keys(self) -> dict[str, Mapping[str, Any]]:
        """Key -> item of `each`."""
        return {key_of({**self.settings, **item}): item for item in self.each}

    @property
    def sha256(self) -> str:
        """SHA-256 of the keys of all cases in their order."""
        return hashlib.sha256("".join(self.keys).encode()).hexdigest()

    def read(self, *paths: Path) -> list[Row]:
        """The rows of these cases in files, in the order of the list; an incomplete last line is left out.

        If a case occurs twice in a file, its last row counts. Rows with the same settings that are not in the list are
        left out. A setting that is missing from an older row is not compared.
        Raises: EmbodieDreamerError for rows of other settings, a case in two files, or a file that is not a file of
        rows.
        """
        found: dict[str, Row] = {}
        for path in {path.resolve(): path for path in paths}.values():
            rows = self._rows(path)
            for key in found.keys() & rows.keys():
                raise EmbodieDreamerError(
                    f"{path} contains the case {brief(dict(self.keys[key]))} a second time; leave one file out."
                )
            found |= rows
        return self.in_order(found.values())

    def in_order(self, rows: Iterable[Row]) -> list[Row]:
        """Rows of different cases in the order of the list."""
        found = {self._key(row): row for row in rows}
        return [found[key] for key in self.keys if key in found]

    def run(self, work: Work, path: Path | None, shard: Shard = WHOLE, jobs: int = 1, also: Sequence[Path] = (),
            progress: ProgressCallback | None = None, unit: str = "cases") -> Iterator[Row]:  # fmt: skip
        """Run the cases of a shard that are in no file yet; append each row to `path` as it arrives, and yield it.

        work: is called with a description, in worker processes; its result must be JSON-serialisable (NumPy numbers and
            arrays are allowed) and may include the case's own "seconds". jobs: as in `io.parallel.each`, with any of
            its backends. also: further files of finished rows. unit: name of the cases in the progress.
        Raises: as `read`; EmbodieDreamerError where another process writes to `path`; any exception of `work`.
        """
        missing = self.missing(path, shard, also)
        with ended_workers():
            results = each(_finish, [(work, dict(self.settings), item) for item in missing], jobs, in_order=False)
            yield from self.record(path, results, len(missing), progress, unit)

    def missing(self, path: Path | None, shard: Shard = WHOLE, also: Sequence[Path] = ()) -> list[Mapping[str, Any]]:
        """The items of a shard that are in no file yet.

        Raises: as `read`.
        """
        existing = [path] if path is not None and path.exists() else []
        done = {self._key(row) for row in self.read(*existing, *also)}
        return [item for key, item in shard.of(list(self.keys.items())) if key not in done]

    def record(self, path: Path | None, results: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]], total: int,
               progress: ProgressCallback | None = None, unit: str = "cases") -> Iterator[Row]:  # fmt: skip
        """Append a row for each item and its result as they arrive, and yield it; see `run`. path: None for no file."""
        report = progress_or_silence(progress)
        report(unit, 0, total)
        with _lines(path) as file:
            for done, (item, result) in enumerate(results, 1):
                row = {**self.settings, **item, **result} | dict(item)
                if file is not None:
                    file.write((json.dumps(row, default=_plain) + "\n").encode())
                    file.flush()
                report(unit, done, total, **item)
                yield row

    def _key(self, row: Mapping[str, Any]) -> str:
        """The key of a row, or of an item.

        Raises: KeyError where a field is missing.
        """
        return key_of({**self.settings, **{name: row[name] for name in (self.each or ({},))[0]}})

    def _rows(self, path: Path) -> dict[str, Row]:
        """The rows of these cases in one file, by key."""
        check_regular(path, what="file of rows")
        found: dict[str, Row] = {}
        try:
            with path.open("rb") as file:
                for number, line in enumerate(file, 1):
                    if line.strip() and line.endswith(b"\n"):
                        row = self._row(line, f"{path}: line {number}")
                        found[self._key(row)] = row
        except OSError as error:
            raise EmbodieDreamerError(f"{path} cannot be read: {error.strerror or error}.") from error
        return {key: row for key, row in found.items() if key in self.keys}

    def _row(self, line: bytes, where: str) -> Row:
        """A line as a row of these settings."""
        try:
            row = json.loads(line)
            self._key(row)
            stored = {name: json.dumps(row[name], sort_keys=True) for name in self.settings if name in row}
        except (ValueError, RecursionError, KeyError, TypeError) as error:
            raise EmbodieDreamerError(f"{where} is not a row of these cases: {brief(error)}.") from error
        for name, text in stored.items():
            wanted = json.dumps(self.settings[name], sort_keys=True)
            if text != wanted:
                raise EmbodieDreamerError(
                    f"{where} has other settings: {name} is {brief(row[name])}, not {brief(json.loads(wanted))}; give another file."
                )
        return row


def _finish(work: Work, settings: dict[str, Any], item: Mapping[str, Any]) -> tuple[Mapping[str, Any], Row]:
    """An item and its result, with the seconds that it took and a stamp of the run."""
    begun = time.perf_counter()
    result = work({**settings, **item})
    return item, {"seconds": time.perf_counter() - begun, **result, "run": run_stamp()}


@contextmanager
def _lines(path: Path | None) -> Iterator[IO[bytes] | None]:
    """Open a file to append whole lines; removes an incomplete last line and, after an error, a file without lines.

    Raises: EmbodieDreamerError where another process has opened it for appending.
    """
    if path is None:
        yield None
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if fcntl is not None:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except (BlockingIOError, PermissionError) as error:
                raise EmbodieDreamerError(f"{path} is being written by another process; give another file.") from error
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)
        try:
            yield file
        except BaseException:
            if not file.tell():
                path.unlink(missing_ok=True)
            raise


def _plain(value: Any) -> Any:
    """A NumPy number or array as Python numbers and lists, for JSON."""
    return value.tolist()
