"""Hooks of the documentation site: pages that live outside docs/, and links out of it."""

from __future__ import annotations

import contextlib
import io
import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
OUTSIDE = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
SHIM = "https://unpkg.com/iframe-worker/shim"  # of the plugin `offline`; ours is in docs/javascripts
ALL_PAGES = "<!-- all pages -->"  # in index.md
INLINE = re.compile(r"<code>([^<]+)</code>")
OPTION = re.compile(r"(?<![\w-])--?\w[\w-]*")
IMAGE = re.compile(r'<img [^>]*src="([^"]+)"[^>]*>')
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that stand in the root of the repository, and the list of commands."""
    for page, source in OUTSIDE.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    files.append(File.generated(config, "reference/command_line.md", content=command_line()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Point links at pages of the site, by their titles; a link to a source file becomes its path."""
    here = page.file.src_uri
    titles = {path: title for _, pages in sections(config.nav) for title, path in pages}
    source = ROOT / OUTSIDE.get(here, f"docs/{here}")

    def target(match: re.Match[str]) -> str:
        image, text, link = match.groups()
        if "://" in link or link.startswith(("#", "mailto:")):
            return match[0]
        path, _, anchor = link.partition("#")
        resolved = (source.parent / path).resolve()
        pages = {(ROOT / name).resolve(): page for page, name in OUTSIDE.items()}
        if resolved in pages:
            found = pages[resolved]
        elif resolved.is_relative_to(ROOT / "docs"):
            found = resolved.relative_to(ROOT / "docs").as_posix()
        elif resolved.exists():
            return f"{text} (`{resolved.relative_to(ROOT).as_posix()}`)"
        else:
            return match[0]  # mkdocs reports it
        if text.endswith(".md"):
            text = titles.get(found, text)
        up = "../" * here.count("/")
        return f"{image}[{text}]({up}{found}{'#' + anchor if anchor else ''})"

    return LINK.sub(target, markdown.replace(ALL_PAGES, all_pages(config.nav)))


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Keep the options of commands on one line; a click on an image opens the file, in full size."""
    html = INLINE.sub(lambda code: OPTION.sub(r'<span class="option">\g<0></span>', code[0]), html)
    return IMAGE.sub(r'<a class="picture" href="\1">\g<0></a>', html)


def sections(nav: list[dict[str, Any]]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Each section of the navigation with the titles and paths of its pages; a page alone has no name of a section."""
    pairs = [pair for one in nav for pair in one.items()]
    return [
        (name, [pair for page in entry for pair in page.items()]) if isinstance(entry, list) else ("", [(name, entry)])
        for name, entry in pairs
    ]


def all_pages(nav: list[dict[str, Any]]) -> str:
    """A line of links for each section of the navigation."""
    lines = []
    for name, pages in sections(nav):
        links = " · ".join(f"[{title}]({path})" for title, path in pages)
        lines.append(f"- {name}: {links}" if name else f"- {links}")
    return "\n".join(lines)


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Let search on pages opened from files use a script of the site, so that it asks no server."""
    return output.replace(SHIM, "../" * page.file.dest_uri.count("/") + "javascripts/file_worker.js")


def on_post_template(output: str, template_name: str, config: Any) -> str:
    """Leave out the page of errors: its links are absolute, so they break where the site is opened from files."""
    return "" if template_name == "404.html" else output


def command_line() -> str:
    """The help text of every verb, 100 columns wide."""
    from embodiedreamer_gym.cli.command import VERBS, build_parser

    os.environ["COLUMNS"] = "100"
    parser = build_parser()
    text = ["# Command line", "The help texts of `embodiedreamer` and its verbs."]
    for verb in ("", *VERBS):
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            parser.parse_args([*verb.split(), "--help"])
        text += [f"## embodiedreamer {verb}".rstrip(), f"```text\n{out.getvalue()}```"]
    return "\n\n".join(text)
