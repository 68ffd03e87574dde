"""What the site has beside the pages in docs/: the repository's own documents, the files that they link to, and the
command line.

A link in any document leads to a file of the repository, so that it can be followed there. On the site it leads to the
page that the file has: documents of the navigation as they are, pictures as pictures, and whatever else as a page that
shows its text.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
OWN = "docs/"  # where pages lie that are named by their path in it
COMMANDS = "reference/commands.md"
TARGET = re.compile(r"(?<=\]\()(?![\w+]+:|[#/])[^)\s#]+(?=[)#])")  # of a link within the repository, without its anchor
PICTURES = (".jpg", ".png", ".svg")
LANGUAGES = {".py": "python", ".toml": "toml", ".cl": "c"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the documents of the navigation that lie outside docs/, the command line, and all that documents link to."""
    files.append(File.generated(config, COMMANDS, content=commands()))
    for name in _names(config.nav):
        if files.get_file_from_path(name) is None and (ROOT / name).is_file():
            files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    for page in list(files.documentation_pages()):
        for target in _targets(page, page.content_string):
            if files.get_file_from_path(_uri(target)) is None:
                files.append(_file(config, target))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to pages of the site; a page alone in its part of the navigation needs no list of it."""
    if page.parent is None:
        page.meta["hide"] = ["navigation"]
    here = _repository_path(page.file)

    def led(match: re.Match[str]) -> str:
        file = files.get_file_from_path(_uri(_resolved(here, match[0])))
        return (
            match[0] if file is None else posixpath.relpath(file.src_uri, posixpath.dirname(page.file.src_uri) or ".")
        )

    return TARGET.sub(led, markdown)


def _names(nav: Any) -> Iterator[str]:
    """The paths in a navigation."""
    if isinstance(nav, str):
        yield nav
    else:
        for part in nav.values() if isinstance(nav, dict) else nav:
            yield from _names(part)


def _repository_path(file: File) -> str:
    """Where a page's text lies in the repository."""
    return OWN + file.src_uri if (ROOT / OWN / file.src_uri).is_file() else file.src_uri


def _resolved(document: str, target: str) -> str:
    """The file, by its path in the repository, that a document's link leads to."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(document), target))


def _targets(page: File, markdown: str) -> Iterator[str]:
    """The files of the repository that a page links to."""
    for target in TARGET.findall(markdown):
        path = _resolved(_repository_path(page), target)
        if (ROOT / path).is_file():
            yield path


def _uri(path: str) -> str:
    """The path that a file of the repository has on the site."""
    return path.removeprefix(OWN) if Path(path).suffix in (".md", *PICTURES) else f"{path}.md"


def _file(config: MkDocsConfig, path: str) -> File:
    """A file of the repository that is in no navigation: a picture as it is, other text as a page that shows it."""
    suffix, uri = Path(path).suffix, _uri(path)
    if suffix in (".md", *PICTURES):
        return File.generated(config, uri, abs_src_path=str(ROOT / path))
    text = (ROOT / path).read_text(encoding="utf-8").rstrip()
    return File.generated(config, uri, content=f"# {path}\n\n`````{LANGUAGES.get(suffix, 'text')}\n{text}\n`````\n")


def commands() -> str:
    """The page of the command line: every command with its options, as `--help` has them."""
    from typer.core import TyperArgument, TyperOption
    from typer.main import get_group

    from shading_atlas_bench.harness.cli.main import app

    group = get_group(app)
    parts = ["# Command line", f"`bench`: {group.help}", "Every command says all of this with `--help`."]
    for name, command in group.commands.items():
        words, rows = ["bench", name, "[OPTIONS]"], ["| option | meaning |", "| --- | --- |"]
        for one in command.params:
            value = one.metavar or str(one.name).upper()
            if isinstance(one, TyperArgument):
                words.append(value)
                rows.append(f"| `{value}` | {_prose(one.help)} |")
            elif isinstance(one, TyperOption):
                names = ", ".join(one.opts)
                rows.append(f"| `{names if one.is_flag else f'{names} {value}'}` | {_prose(one.help)} |")
        parts += [f"## bench {name}", f"`{' '.join(words)}`", _prose(command.help), "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


def _prose(text: str | None) -> str:
    """Help as Markdown: without the escapes of the console, safe in a cell of a table."""
    return (text or "").replace("\\[", "[").replace("|", "\\|").replace("<", "&lt;")
