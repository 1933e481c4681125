"""Hooks of mkdocs: pages from files outside of this folder, and links between both.

The README, the changelog, the guide for contributors and the map of the package stay where a reader
of the repository finds them, and are pages of the site as well.
"""

import re
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath

ROOT = Path(__file__).resolve().parent.parent
# Page of the site by file of the repository.
PAGES = {
    "README.md": "overview.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "jaxid/README.md": "map.md",
}
# Pages that another hook writes, `notebook_pages.py`.
NOTEBOOKS = {
    f"notebooks/{path.name}": f"notebooks/{path.stem}.md"
    for path in (ROOT / "notebooks").glob("*.ipynb")
}
TARGETS = PAGES | NOTEBOOKS
SOURCES = {page: source for source, page in TARGETS.items()}
# A fenced block or inline code, which stays; or a link.
CODE_OR_LINK = re.compile(
    r"^ *(?P<fence>```|~~~).*?^ *(?P=fence) *$|`[^`\n]*`"
    r"|(?P<image>!?)\[(?P<words>[^\]]*)\]\((?P<address>[^)\s]+)\)",
    re.MULTILINE | re.DOTALL,
)
SECTION = re.compile(r"^<!-- README: (.+) -->$", re.MULTILINE)


def on_files(files, config):
    """Add the pages whose files are outside of `docs`."""
    from mkdocs.structure.files import File  # here, as tests use the functions without mkdocs

    for source, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Insert sections of the README, and turn links to files of the repository into links to pages.

    A line `<!-- README: Install -->` is replaced by the section `Install`.
    """
    return page_text(markdown, page.file.src_uri)


def page_text(markdown: str, here: str) -> str:
    """Return the text of the page `here`, a path in `docs`."""
    markdown = _translated(markdown, SOURCES.get(here, f"docs/{here}"), here)
    return SECTION.sub(lambda match: _translated(_section(match[1]), "README.md", here), markdown)


def _section(title: str) -> str:
    """Return a section of the README, with its heading."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    body = text.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return f"## {title}\n{body}"


def _translated(markdown: str, source: str, here: str) -> str:
    """Return a text of the file `source` for the page `here`."""
    return CODE_OR_LINK.sub(lambda match: _link(match, source, here), markdown)


def _link(match: re.Match[str], source: str, here: str) -> str:
    """Return a link, its words alone where the site does not have its target; code as it stands."""
    if match["address"] is None:
        return match[0]
    path, _, anchor = match["address"].partition("#")
    if not path or "://" in path:
        return match[0]
    target = normpath(str(PurePosixPath(source).parent / path))
    if target in TARGETS:
        page = TARGETS[target]
    elif match["image"] and target.startswith("notebooks/"):  # a figure of a notebook
        page = target
    elif target.startswith("docs/"):
        page = target.removeprefix("docs/")
    else:
        return match["words"]
    address = relpath(page, str(PurePosixPath(here).parent)) + (f"#{anchor}" if anchor else "")
    return f"{match['image']}[{match['words']}]({address})"
