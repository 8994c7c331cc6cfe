"""Every python block of the documents runs, every `embodiedreamer …` line parses.

The blocks of one file share a namespace and an empty temporary folder. A python block inside an HTML comment
runs too, unseen by the reader (set-up). `<!-- skip-test: reason -->` before a block leaves it out, counted as
skipped.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [
    "README.md",
    "CONTRIBUTING.md",
    *sorted(str(p.relative_to(ROOT)) for p in ROOT.glob("docs/**/*.md")),
]
BLOCK = re.compile(
    r"(?:<!-- *skip-test: *(?P<reason>[^\n]*?) *-->\s*)?"
    r"^(?P<indent> *)```(?P<language>python|bash|console|sh)\n(?P<code>.*?)^(?P=indent)```",
    re.MULTILINE | re.DOTALL,
)


class Block(NamedTuple):
    """One fenced block: where it stands and what it says."""

    document: str
    line: int
    language: str
    reason: str | None
    code: str

    def __str__(self) -> str:
        return f"{self.document}:{self.line}"


def blocks_of(document: str, text: str) -> list[Block]:
    """All fenced python and shell blocks, in order."""
    found = []
    for match in BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("code")) + 1
        code = re.sub(rf"^{match['indent']}", "", match["code"], flags=re.MULTILINE)
        found.append(Block(document, line, match["language"], match["reason"], code))
    return found


def command_lines(block: Block) -> list[list[str]]:
    """The arguments of each `embodiedreamer` line, up to a pipe, a redirection or a comment."""
    commands = []
    for line in block.code.replace("\\\n", " ").splitlines():
        words = line.strip().removeprefix("$ ")
        if not re.match(r"(\.venv/bin/)?embodiedreamer( |$)", words):
            continue
        lexer = shlex.shlex(words, posix=True, punctuation_chars="|&;<>")
        lexer.whitespace_split = True
        arguments = []
        for word in list(lexer)[1:]:
            if set(word) <= set("|&;<>"):
                break
            arguments.append(word)
        commands.append(arguments)
    return commands


BLOCKS = [b for d in DOCUMENTS if (ROOT / d).exists() for b in blocks_of(d, (ROOT / d).read_text())]
COMMANDS = [(b, words) for b in BLOCKS if b.language != "python" for words in command_lines(b)]


@pytest.mark.usefixtures("shared_demo")
@pytest.mark.parametrize("document", [one for one in DOCUMENTS if "tutorials" not in one])  # those: test_tutorials.py
def test_python_blocks_run(document: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert (ROOT / document).exists(), f"{document} is missing"
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "document"}
    for block in BLOCKS:
        if block.document == document and block.language == "python" and block.reason is None:
            code = "\n" * (block.line - 1) + block.code  # a traceback shows the document's own line
            exec(compile(code, str(ROOT / document), "exec"), namespace)


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.reason is not None and b.language == "python"], ids=str)
def test_skipped_blocks_say_why(block: Block) -> None:
    assert block.reason, f"{block}: say why it is skipped"
    pytest.skip(f"{block}: {block.reason}")


@pytest.mark.parametrize(("block", "words"), COMMANDS, ids=[f"{b} {' '.join(w[:1])}" for b, w in COMMANDS])
def test_command_lines_parse(block: Block, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    from embodiedreamer_gym.cli.command import build_parser, renamed

    try:
        assert renamed(words) == words, f"{block}: use the present names"
        build_parser().parse_args(words)
    except SystemExit as stop:
        assert stop.code == 0, f"{block}: {capsys.readouterr().err}"  # 0: --help or --version


def test_the_reader_finds_blocks() -> None:
    text = (
        "a\n```python\nx = 1\n```\n<!-- skip-test: needs a robot -->\n```python\ny\n```\n"
        "<!--\n```python\nz = 3\n```\n-->\n- b\n\n  ```bash\n  make install\n"
        "  embodiedreamer fit --out 'a b.json' \\\n    logs/*.hdf5 | tee log  # why\n  ```\n"
    )
    blocks = blocks_of("doc.md", text)
    assert [(b.line, b.code, b.reason) for b in blocks[:3]] == [
        (3, "x = 1\n", None),
        (7, "y\n", "needs a robot"),
        (11, "z = 3\n", None),
    ]
    assert command_lines(blocks[3]) == [["fit", "--out", "a b.json", "logs/*.hdf5"]]
