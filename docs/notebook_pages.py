"""Hook of mkdocs: a page for each notebook of the repository, with outputs on request.

The variable `EXECUTE_NOTEBOOKS` is a pattern of notebook names, `*` for all: those that match are
executed, all others are shown as code and text. An executed notebook is kept in `build/notebooks`
until the notebook, the package or the benchmarks change. Packages that build the site are imported
in the functions, so that the tests read this file without them.
"""

import hashlib
import os
import re
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / "build" / "notebooks"
TIMEOUT = 1800  # [s] of one cell (chosen: ten times the longest)
WITHOUT_OUTPUTS = """!!! note "Built without outputs"

    This page shows code and text. `EXECUTE_NOTEBOOKS="*" mkdocs build --strict` builds it with
    tables and figures, see [Notebooks](../docs/notebooks.md)."""
# Outputs as fenced blocks, which no other hook changes, and figures with a description.
TEMPLATE = """{% extends 'markdown/index.md.j2' %}
{% macro block(text) %}
```text title="Output"
{{ text | strip_ansi | trim('\n') }}
```
{% endmacro %}
{% block stream %}{{ block(output.text) }}{% endblock stream %}
{% block data_text scoped %}
{% if output.data['text/plain'] %}{{ block(output.data['text/plain']) }}{% endif %}
{% endblock data_text %}
{% block data_png %}
![Figure of the code above]({{ output.metadata.filenames['image/png'] | path2url }})
{% endblock data_png %}
"""
CODE_OR_FORMULA = re.compile(
    r"^(?P<fence>```|~~~).*?^(?P=fence)$|`[^`\n]*`"
    r"|\$\$(?P<display>[^$]+)\$\$|\$(?P<inline>[^$]+)\$",
    re.MULTILINE | re.DOTALL,
)


def on_files(files, config):
    """Add the page of each notebook, and its figures."""
    import nbformat
    from mkdocs.structure.files import File

    # Not an option `!ENV` of mkdocs.yml, which fails for the value "*", a sign of YAML.
    pattern = os.environ.get("EXECUTE_NOTEBOOKS", "")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        if pattern and path.match(f"{pattern}.ipynb"):
            notebook = executed(path)
        else:
            notebook = without_outputs(nbformat.read(path, as_version=4))
        for address, content in page_with_figures(notebook, path.stem).items():
            files.append(File.generated(config, f"notebooks/{address}", content=content))
    return files


def without_outputs(notebook):
    """Return a notebook with a note below its title that describes how to see its outputs."""
    title, text = notebook.cells[0].source.split("\n", 1)
    notebook.cells[0].source = f"{title}\n\n{WITHOUT_OUTPUTS}\n{text}"
    return notebook


def page_with_figures(notebook, name: str) -> dict[str, str | bytes]:
    """Return the Markdown of a notebook, and its figures by address relative to the page."""
    from nbconvert import MarkdownExporter
    from traitlets.config import Config

    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = with_mathml(cell.source)
    kinds = ["image/png", "text/plain"]
    exporter = MarkdownExporter(
        raw_template=TEMPLATE, config=Config(NbConvertBase={"display_data_priority": kinds})
    )
    figures = {"unique_key": name, "output_files_dir": f"{name}_files"}
    text, resources = exporter.from_notebook_node(notebook, resources=figures)
    return {f"{name}.md": text, **resources["outputs"]}


def executed(path: Path):
    """Return a notebook with its outputs, from the cache if its sources are the same."""
    import nbformat
    from nbclient import NotebookClient

    kept, key = CACHE / path.name, _key(path)
    if kept.exists():
        notebook = nbformat.read(kept, as_version=4)
        if notebook.metadata.get("sources") == key:
            return notebook
    notebook = nbformat.read(path, as_version=4)
    search_path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as folder:  # for the files that a notebook writes
        client = NotebookClient(
            notebook,
            timeout=TIMEOUT,
            kernel_name="python3",
            coalesce_streams=True,
            resources={"metadata": {"path": folder}},
        )
        client.execute(env={**os.environ, "PYTHONPATH": search_path})
    notebook.metadata["sources"] = key
    CACHE.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, kept)
    return notebook


def _key(path: Path) -> str:
    """Return a hash of the sources of the outputs: notebook, package, benchmarks, data folder."""
    key = hashlib.sha256(path.read_bytes() + os.environ.get("JAXID_DATA", "").encode())
    for folder in ("jaxid", "benchmarks"):
        for source in sorted((ROOT / folder).rglob("*")):
            if source.suffix in (".py", ".csv"):
                key.update(source.read_bytes())
    return key.hexdigest()


def with_mathml(markdown: str) -> str:
    """Return a text with its LaTeX formulas as MathML, which browsers show without a script."""
    from latex2mathml.converter import convert

    def formula(match: re.Match[str]) -> str:
        if match["display"]:
            return f"<div>{convert(match['display'].strip(), display='block')}</div>"
        # Markdown takes <math> at the start of a line for the start of a block.
        return f"<span>{convert(match['inline'])}</span>" if match["inline"] else match[0]

    return CODE_OR_FORMULA.sub(formula, markdown)
