"""Hooks of mkdocs: pages from files outside of this folder, and links between both.

The README, the changelog, the guide for contributors and the map of the package stay where a reader
of the repository finds them, and are pages of the site as well.
"""

import re
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent
# Page of the site by file of the repository.
PAGES = {
    "README.md": "overview.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "jaxid/README.md": "map.md",
}
SOURCES = {page: source for source, page in PAGES.items()}
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
SECTION = re.compile(r"^<!-- README: (.+) -->$", re.MULTILINE)


def on_files(files, config):
    """Add the pages whose files are outside of `docs`."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Insert sections of the README, and turn links to files of the repository into links to pages.

    A line `<!-- README: Install -->` is replaced by the section `Install`.
    """
    here = page.file.src_uri
    source = SOURCES.get(here, f"docs/{here}")
    markdown = _translated(markdown, source, here)
    return SECTION.sub(lambda match: _translated(_section(match[1]), "README.md", here), markdown)


def _section(title: str) -> str:
    """Return a section of the README, with its heading."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    body = text.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return f"## {title}\n{body}"


def _translated(markdown: str, source: str, here: str) -> str:
    """Return a text of the file `source` for the page `here`."""
    return LINK.sub(lambda link: _link(link, source, here), markdown)


def _link(link: re.Match[str], source: str, here: str) -> str:
    """Return a link; the words alone where the site does not have its target."""
    image, words, address = link.groups()
    path, _, anchor = address.partition("#")
    if not path or "://" in path:
        return link[0]
    target = normpath(str(PurePosixPath(source).parent / path))
    if target in PAGES:
        page = PAGES[target]
    elif target.startswith("docs/"):
        page = target.removeprefix("docs/")
    else:
        return words
    address = relpath(page, str(PurePosixPath(here).parent)) + (f"#{anchor}" if anchor else "")
    return f"{image}[{words}]({address})"
