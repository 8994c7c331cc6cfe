"""The tutorials: commands and python blocks run in order in one folder, and print what the page shows.

A text block after a block is its expected output: its lines appear in this order, numbers within TOLERANCE; `...` stands for
any lines. Blocks marked `<!-- skip-test: reason -->` do not run.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.test_docs_blocks import ROOT, blocks_of, command_lines

TOLERANCE = 0.2  # relative: the last digits of a fit depend on the processor
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
LONG = ("own_bench", "policy")  # these train networks
FENCE = re.compile(r"^ *```(?P<language>\w*)\n(?P<code>.*?)^ *```", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def expected_after(text: str, line: int) -> list[str]:
    """Lines of the text block that follows the block whose code begins at a line; none where another block follows."""
    fences = list(FENCE.finditer(text))
    begins = [text.count("\n", 0, fence.start("code")) + 1 for fence in fences]
    after = fences[begins.index(line) + 1 :][:1]
    return after[0]["code"].splitlines() if after and after[0]["language"] == "text" else []


def alike(expected: str, printed: str) -> bool:
    """Whether two lines have the same words, and numbers that differ by TOLERANCE at most."""
    if NUMBER.sub("#", expected).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= TOLERANCE * max(abs(float(a)), abs(float(b)), 1e-3) for a, b in pairs)


def first_missing(expected: Sequence[str], printed: Sequence[str]) -> str | None:
    """The first expected line that was not printed after those before it."""
    at = 0
    for line in (one for one in expected if one.strip() and one.strip() != "..."):
        while at < len(printed) and not alike(line, printed[at]):
            at += 1
        if at == len(printed):
            return line
        at += 1
    return None


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=pytest.mark.release if path.stem in LONG else pytest.mark.slow, id=path.stem)
        for path in TUTORIALS
    ],
)
def test_tutorial(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from embodiedreamer_gym.cli.command import main

    monkeypatch.chdir(tmp_path)
    text, namespace = path.read_text(), {"__name__": "tutorial"}
    for block in blocks_of(str(path.relative_to(ROOT)), text):
        if block.reason is not None:
            continue
        capsys.readouterr()
        if block.language == "python":
            exec(compile("\n" * (block.line - 1) + block.code, str(path), "exec"), namespace)
        for words in command_lines(block) if block.language == "bash" else ():
            main(words)
        out, err = capsys.readouterr()
        printed = [*err.splitlines(), *out.splitlines()]
        missing = first_missing(expected_after(text, block.line), printed)
        assert missing is None, f"{block}: not printed: {missing}\n" + "\n".join(printed)


def test_lines_are_compared_by_words_and_numbers() -> None:
    assert alike("joint1  0.306 N m  [0.29, 0.34]", "joint1 0.31 N m [0.30,  0.33]")
    assert not alike("joint1 0.3", "joint2 0.3") and not alike("joint1 0.3", "joint1 0.5")
    assert first_missing(["a 1", "...", "b 2"], ["a 1.01", "x", "b 2"]) is None
    assert first_missing(["b 2", "a 1"], ["a 1", "b 2"]) == "a 1"


def test_expected_output_is_the_text_block_that_follows() -> None:
    text = "```bash\nembodiedreamer a\n```\n\n```text\nout 1\n```\n\n```bash\nembodiedreamer b\n```\nwords\n```python\nx\n```\n```text\n2\n```\n"
    assert expected_after(text, 2) == ["out 1"]
    assert expected_after(text, 10) == []
    assert expected_after(text, 14) == ["2"]
