"""Text logs: lines and tables, read with size limits and any line ending."""

from __future__ import annotations

import csv
import json
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.files import check_regular
from embodiedreamer_gym.recordings.hdf5 import MAX_NUMBERS

MAX_LINE = 1_000_000  # characters
MAX_COLUMNS = 4096
NO_NUMBER = (ValueError, TypeError, OverflowError, RecursionError)  # raised by float and json.loads


@contextmanager
def open_text(path: Path) -> Iterator[TextIO]:
    """Open a UTF-8 text file; CR, LF and CR LF all end a line.

    Raises: RecordingError where the file cannot be read, is not UTF-8 text, or proves to be invalid csv in the block.
    """
    check_regular(path, RecordingError)
    try:
        with path.open(encoding="utf-8-sig") as file:
            yield file
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: it is not UTF-8 text") from error
    except csv.Error as error:
        raise RecordingError(f"{path}: it is not a readable csv: {error}") from error
    except OSError as error:
        raise RecordingError(f"{path}: it cannot be read ({error.strerror or error})") from error


def lines_of(file: TextIO, path: Path) -> Iterator[str]:
    """The lines of a file.

    Raises: RecordingError for a line of MAX_LINE characters or more.
    """
    while line := file.readline(MAX_LINE):
        if len(line) == MAX_LINE:
            raise RecordingError(f"{path}: a line has {MAX_LINE} characters or more; this is not a log")
        yield line


def check_header(header: Sequence[str], path: Path) -> None:
    """Raises: RecordingError for a column that occurs twice, and for more than MAX_COLUMNS columns."""
    if len(header) > MAX_COLUMNS:
        raise RecordingError(f"{path}: the header has {len(header)} columns; at most {MAX_COLUMNS} are read")
    twice = sorted({column for column in header if header.count(column) > 1})
    if twice:
        raise RecordingError(f"{path}: the column {twice[0]} occurs more than once; column names must differ")


def table(
    rows: Iterable[list[str]], first: int, width: int, path: Path, parse: Callable[[list[str], int], Any]
) -> np.ndarray:
    """Rows of text as an array (T, width); empty rows are left out.

    first: line number of the first row, for messages; parse: returns the numbers of a row, given the row and its line
    number.
    Raises: RecordingError for a row of another width, and for more than MAX_NUMBERS numbers.
    """
    values = array("d")
    for number, row in enumerate(rows, first):
        if not row:
            continue
        numbers = parse(row, number)
        if len(numbers) != width:
            raise RecordingError(f"{path}: line {number} has {len(numbers)} values for {width} columns")
        values.extend(numbers)
        if len(values) > MAX_NUMBERS:
            raise RecordingError(f"{path}: it holds more than {MAX_NUMBERS} numbers; split it into shorter logs")
    if not values:
        raise RecordingError(f"{path}: there is no row below the header")
    return np.array(values).reshape(-1, width)


def json_numbers(text: str | None) -> list[float]:
    """A JSON list of numbers.

    Raises: one of NO_NUMBER for other text.
    """
    return [float(value) for value in json.loads(text or "")]


def line_end_notes(file: TextIO) -> tuple[str, ...]:
    """A note where the lines end in bare carriage returns."""
    return ("its lines end in bare carriage returns, which were read as line ends",) if file.newlines == "\r" else ()
