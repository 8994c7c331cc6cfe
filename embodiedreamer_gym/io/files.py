"""User files: atomic writes, checks before long work, and JSON with a limit of size and depth."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import EmbodieDreamerError

MAX_BYTES = 64_000_000  # largest size of a JSON file
MAX_DEPTH = 64  # most levels of nested lists and objects in a JSON file
MAX_DIGITS = 39  # most digits of an integer in a JSON file; longer ones are read as floats


@contextmanager
def atomic_file(
    path: str | os.PathLike[str], error: type[EmbodieDreamerError] = EmbodieDreamerError, suffix: str = ".part"
) -> Iterator[Path]:
    """Yield a path to write to; the file replaces `path` when the block ends without an exception.

    When the block fails, nothing is left behind and an older file stays as it was. A symbolic link stays; its target
    is replaced. The file gets the umask's mode.
    error: class of the error; suffix: suffix of the temporary name, for writers that choose the format by it.
    Raises: `error` for an OSError inside the block, with the path and the reason.
    """
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name[:50]}.{os.getpid()}{suffix}")
    try:
        if target.exists() and not target.is_file():
            raise error(f"{path} cannot be written: it is {'a folder' if target.is_dir() else 'not a regular file'}.")
        yield part
        part.replace(target)
    except OSError as reason:
        raise error(f"{path} cannot be written: {reason.strerror or reason}.") from reason
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


@contextmanager
def atomic_folder(
    path: str | os.PathLike[str], error: type[EmbodieDreamerError] = EmbodieDreamerError
) -> Iterator[Path]:
    """Yield an empty folder to fill; it becomes `path` when the block ends without an exception.

    Raises: `error` where `path` exists and is not an empty folder, and for an OSError inside the block.
    """
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name[:50]}.{os.getpid()}.part")
    try:
        if target.exists() and (not target.is_dir() or any(target.iterdir())):
            raise error(f"{path} is not empty; give a new folder.")
        part.mkdir(parents=True)
        yield part
        if target.is_dir():
            target.rmdir()
        part.rename(target)
    except OSError as reason:
        raise error(f"{path} cannot be written: {reason.strerror or reason}.") from reason
    finally:
        shutil.rmtree(part, ignore_errors=True)


def check_outputs(*files: Path | None, folders: Sequence[Path | None] = ()) -> None:
    """Check, before long work begins, that these files and folders can be written; None is skipped.

    A file's folder must exist; a folder may be made, with its parents. Nothing is left behind.
    Raises: EmbodieDreamerError that names the first path that cannot be written, and why.
    """
    for path in (*files, *folders):
        if path is None:
            continue
        try:
            is_folder = not any(path is one for one in files)
            target = Path(os.path.realpath(path))
            parent = target.parent
            if is_folder:
                parent = next(one for one in (target, *target.parents) if one.exists())
            elif target.exists() and not target.is_file():
                reason = "a folder" if target.is_dir() else "not a regular file"
                raise EmbodieDreamerError(f"{path} cannot be written: it is {reason}; name a file.")
            if parent.exists() and not parent.is_dir():
                raise EmbodieDreamerError(f"{path} cannot be written: {parent} is a file, not a folder.")
            if not parent.exists():
                raise EmbodieDreamerError(f"{path} cannot be written: folder {parent} does not exist; make it first.")
            with tempfile.TemporaryFile(dir=parent):
                pass
        except OSError as reason:
            raise EmbodieDreamerError(f"{path} cannot be written: {reason.strerror or reason}.") from reason


def write_json(data: Any, path: str | os.PathLike[str], error: type[EmbodieDreamerError] = EmbodieDreamerError,
               sort_keys: bool = False) -> None:  # fmt: skip
    """Write JSON (UTF-8, indented by one) atomically.

    Raises: `error` when the file cannot be written; ValueError for a number that is not finite.
    """
    with atomic_file(path, error) as part:
        part.write_text(json.dumps(data, indent=1, sort_keys=sort_keys, allow_nan=False) + "\n", encoding="utf-8")


def check_regular(
    path: str | os.PathLike[str], error: type[EmbodieDreamerError] = EmbodieDreamerError, what: str = "file"
) -> None:
    """Check that a path, if it exists, is a file or a folder: opening a pipe or a device could block.

    Raises: `error` for anything else.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        raise error(f"{what} {path} is not a regular file.")


def read_json(
    path: str | os.PathLike[str], error: type[EmbodieDreamerError] = EmbodieDreamerError, what: str = "file"
) -> Any:
    """Read JSON of at most MAX_BYTES bytes and MAX_DEPTH levels; integers of more than MAX_DIGITS digits become floats.

    what: kind of file, for the message, such as "model".
    Raises: `error` for a file that is missing, too large, not UTF-8, not JSON or nested too deeply.
    """
    path = Path(path)
    check_regular(path, error, what)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise error(f"{what} {path} is larger than {MAX_BYTES // 1_000_000} MB.")
        data = json.loads(path.read_text(encoding="utf-8-sig"), parse_int=_integer)
        _check_tree(data)
    except OSError as reason:
        raise error(f"{what} {path} cannot be read: {reason.strerror or reason}.") from reason
    except RecursionError as reason:
        raise error(f"{what} {path} is not readable JSON: it is nested more than {MAX_DEPTH} levels deep.") from reason
    except UnicodeError as reason:
        raise error(f"{what} {path} is not readable JSON: it is not UTF-8 text.") from reason
    except json.JSONDecodeError as reason:
        raise error(f"{what} {path} is not readable JSON: {reason}.") from reason
    return data


def _integer(text: str) -> int | float:
    return int(text) if len(text) <= MAX_DIGITS else float(text)


def _check_tree(data: Any) -> None:
    """Raises: RecursionError for more than MAX_DEPTH levels, UnicodeError for an unpaired surrogate in a string."""
    level = [data]
    for _ in range(MAX_DEPTH + 1):
        below: list[Any] = []
        for one in level:
            if isinstance(one, str):
                one.encode()
            elif isinstance(one, dict | list):
                below += [*one, *one.values()] if isinstance(one, dict) else one
        if not below:
            return
        level = below
    raise RecursionError
