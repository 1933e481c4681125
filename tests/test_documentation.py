"""The documentation: its code runs as printed, its numbers are those that the code prints, and its
API reference contains every public name. `mkdocs` builds it, where that is installed.
"""

import base64
import importlib.util
import itertools
import re
import subprocess
import sys
import types
from pathlib import Path

import architecture_words
import nbformat
import pytest
from printed_code import blocks, run_pages
from public_names import definition, module_of, public_names
from shown_names import shown_definitions

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
NOTEBOOKS = sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb"))
START = "index.md"  # stands by itself; the other pages continue its code
PAGES = (
    START,
    *("choose.md", "recipes.md", "from_scipy.md", "from_matlab.md", "from_sidpac.md"),
    *("from_pysindy.md", "method.md", "uncertainty.md", "input_design.md", "many_cases.md"),
    *("advice.md", "files.md", "flights.md", "effects.md"),
)
RUN_ELSEWHERE = {  # page: test of its blocks
    "real_records.md": "study/test_identify_layouts.py",
    "study_file.md": "test_main.py",
}
MODULES = (  # with a page in docs/api
    "jaxid",
    *(f"jaxid.{name}" for name in ("data", "models", "effects", "hold", "spectrum", "smoothing")),
    *(
        f"jaxid.{name}"
        for name in ("uncertainty", "batches", "structure", "diagnosis", "design", "loop", "study")
    ),
    "jaxid.report",
    "jaxid.aircraft",
)
TRUE_K, TRUE_C = 2.0, 0.3  # of the spring on the first page


def text_of(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


def page_of(module: str) -> str:
    return "api/index.md" if module == "jaxid" else f"api/{module.rpartition('.')[2]}.md"


RUN_HERE = (*PAGES, *map(page_of, MODULES))


# The code. ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def printed(tmp_path_factory, reader_environment):
    """Output of each page; one interpreter for the guides, one for the API reference."""
    printed = {}
    for pages in (PAGES, (START, *map(page_of, MODULES))):
        code = {page: blocks(text_of(page), "python") for page in pages}
        printed |= run_pages(code, tmp_path_factory.mktemp("pages"), reader_environment)
    return printed


@pytest.fixture(scope="module")
def output(printed):
    """Lines that a page prints; `output(page, start)` is the first line that begins so."""

    def lines(page, start):
        found = [line for line in printed[page].output.splitlines() if line.startswith(start)]
        assert found, f"{page} prints no line that begins with {start!r}"
        return found[0]

    return lines


def numbers(line: str) -> list[float]:
    """Return the numbers in a line; digits inside of words are no numbers."""
    return [float(x) for x in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?(?![\w])", line)]


def test_every_page_with_code_is_run():
    pages = {file.relative_to(DOCS).as_posix() for file in DOCS.rglob("*.md")}
    with_code = {page for page in pages if blocks(text_of(page), "python")}
    assert with_code | set(map(page_of, MODULES)) == {*RUN_HERE, *RUN_ELSEWHERE}


@pytest.mark.parametrize("page", RUN_HERE)
def test_the_code_of_the_page_runs(page, printed):
    assert not printed[page].error, printed[page].error


# Statements about printed numbers. ----------------------------------------------------------------


def test_the_first_fit_prints_the_table_shown(output):
    """The table in the text has four digits or more; another processor rounds the last ones."""
    shown = blocks(text_of(START), "text")[0]
    for name, truth in (("k ", TRUE_K), ("c ", TRUE_C)):
        ours = numbers(output(START, name))
        theirs = numbers(next(line for line in shown.splitlines() if line.startswith(name)))
        assert theirs == pytest.approx(ours, rel=2e-3)
        _, value, error, *_ = ours
        assert abs(value - truth) < 2 * error  # "within two standard errors"


def test_the_test_record_is_predicted_to_its_noise(output):
    (error,) = numbers(output(START, "RMS error").removesuffix(" mm"))
    assert error == pytest.approx(10.0, rel=0.1)
    assert " yes " in output(START, "x  ")  # the residual is white


def test_colour_makes_the_bound_three_times_too_small(output):
    bound, corrected, autoregressive = numbers(output("choose.md", "k: Cramer-Rao"))
    assert corrected / bound == pytest.approx(3.0, abs=0.5)
    assert autoregressive / bound > 2.0


def test_square_wave_is_near_the_spline_and_keeps_its_limits(output):
    (ratio,) = numbers(output("input_design.md", "standard error over the spline's"))
    assert ratio == pytest.approx(1.10, abs=0.02)
    (share,) = numbers(output("input_design.md", "largest share of a limit"))
    assert share <= 1.0


def test_process_noise_ends_on_its_bound(output):
    assert "process.v on the bound" in output("choose.md", "bounds:")


def test_the_road_is_in_the_simulation_and_not_in_the_prediction(printed):
    text = printed["choose.md"].output
    tables = re.findall(r"Prediction of 1 record.*\n.*\nx +(\S+)", text)
    filtered, simulated = map(float, tables)
    assert filtered < 0.02  # the noise of the sensor is 0.01 m
    assert simulated > 5 * filtered
    assert "each predicted from the samples before it" in text


def test_a_finer_step_changes_less_than_a_hundredth_of_the_noise(output):
    (change,) = numbers(output("choose.md", "change by a finer step").removesuffix(" mm"))
    assert change < 0.1


def test_a_far_start_is_named_and_left_by_pieces(output):
    assert "the residual of x is large and no noise." in output("choose.md", "poor fit")
    before, after = numbers(output("choose.md", "explained").replace(" %", ""))
    assert before < 5
    assert after > 98


def test_the_eight_lines_end_at_their_start_with_success(printed):
    first, second, ours = printed["from_scipy.md"].output.splitlines()
    assert first.startswith("True")
    assert numbers(first)[:2] == pytest.approx([1.0, 0.1], abs=1e-3)
    k, c, error_k, error_c = numbers(second)
    our_k, our_c, our_error_k, our_error_c = numbers(ours)
    assert abs(k - our_k) < our_error_k  # "within a standard error"
    assert abs(c - our_c) < our_error_c
    assert [error_k, error_c] == pytest.approx([our_error_k, our_error_c], rel=0.25)


def test_regressions_find_the_true_terms(printed):
    for page, truth in (
        ("from_sidpac.md", {"alpha": -0.6, "q": -8.0, "elevator": -1.2}),
        ("from_pysindy.md", {"x": -2.0, "v": -0.3, "force": 1.0, "x^3": -0.5}),
    ):
        rows = [line.split() for line in printed[page].output.splitlines()]
        table = {row[0]: (float(row[1]), float(row[2])) for row in rows if len(row) == 4}
        assert set(table) == set(truth)
        for name, value in truth.items():
            assert abs(table[name][0] - value) < 5 * table[name][1]


def test_weak_form_has_the_printed_errors_which_are_smaller_by_a_half(output):
    rows = text_of("from_pysindy.md").split("| root mean square error")[1].splitlines()[2:4]
    ours, by_derivatives = (
        numbers(output("from_pysindy.md", f"rms errors, {label}"))
        for label in ("weak form", "derivatives")
    )
    for line, errors in zip(rows, (ours, by_derivatives), strict=True):
        assert numbers(line) == pytest.approx(errors, rel=0.05)
    assert all(2 * a < b for a, b in zip(ours, by_derivatives, strict=True))


def test_weak_form_selects_the_four_terms_in_most_draws(output):
    _, *counts = numbers(output("from_pysindy.md", "number of terms"))
    assert counts.count(4) == 15  # "15 give the four true terms, and five one term more"
    assert counts.count(5) == 5


def test_the_cost_falls_and_nothing_is_weak(output):
    costs = numbers(output("method.md", "cost:"))
    assert all(after <= before for before, after in itertools.pairwise(costs))
    R, mean_square = numbers(output("method.md", "R:"))
    assert mean_square == pytest.approx(R, rel=0.02)
    assert output("method.md", "weak directions").endswith("()")


def test_the_second_opinion_is_sure_of_the_cubic_term_and_of_nothing_else(output):
    added = output("method.md", "round 1: added x^3 in v")
    assert "p = 0.001" in added
    rest = output("method.md", "round 2: added None")
    _, p, drawn, required = numbers(rest)
    assert p > 0.01
    # 10 of 999 draws lie beyond the threshold, which is known to 7 %; that of blocks to 10 %
    assert drawn == pytest.approx(required, rel=0.3)


def test_the_mass_determines_the_error_of_k(printed):
    table = printed["uncertainty.md"].output.split("parameter std. error")[1].splitlines()
    _, k, c = (numbers(line) for line in table[:3])
    assert k[0] / TRUE_K == pytest.approx(3e-4, rel=0.2)  # 0.03 %
    assert k[2] / TRUE_K == pytest.approx(0.01, rel=0.05)  # 1 %
    assert c[2] / c[0] < 1.5  # "hardly changes"


def test_the_errors_of_the_3211_are_the_smallest(output, printed):
    names = output("input_design.md", "standard error").split()[2:]
    table = printed["input_design.md"].output.split("standard error ")[1].splitlines()
    for row in table[1:3]:
        errors = dict(zip(names, numbers(row), strict=True))
        assert min(errors, key=errors.__getitem__) == "3-2-1-1"
        assert errors["3-2-1-1"] < 0.5 * errors["step"]  # "less than half"


def test_the_requirements_are_met_by_the_smaller_input(output):
    for requirement in ("pilot", "instruments", "modelling", "integrity"):
        assert output("input_design.md", requirement).split()[1:3] == ["not", "met"]
    for requirement in ("procedure", "objective", "sensitivity"):
        assert output("input_design.md", requirement).split()[1] == "met"
    assert output("input_design.md", "smaller input:").startswith("smaller input: True")


def test_the_faults_of_the_record_are_found(output, printed):
    assert printed["advice.md"].output.startswith("No finding.")
    share, longest = numbers(output("advice.md", "missing samples"))
    assert (share, longest) == pytest.approx((0.05, 1.1))
    assert numbers(output("advice.md", "drift"))[0] == pytest.approx(0.01, rel=0.2)


def test_files_and_tables_become_records(output, printed):
    pages = printed["files.md"].output
    assert "3 samples, 0.2 s, 33.3 % of the samples missing" in pages
    assert numbers(output("files.md", "gyro"))[-2] == pytest.approx(1 / 10**0.5, abs=0.01)
    moved = numbers(output("files.md", "position"))
    assert moved[-2] == pytest.approx(0.9, abs=0.01)


def test_a_saved_fit_is_read_back(output):
    assert output("recipes.md", "equal:") == "equal: True ('k', 'c')"


def test_noises_steppers_and_files_agree(output, printed):
    lines = printed["recipes.md"].output.splitlines()
    values = [float(line.removeprefix("k: ")) for line in lines if line.startswith("k: ")]
    assert values == pytest.approx([TRUE_K] * 3, abs=0.005)
    (deviation,) = numbers(output("recipes.md", "largest deviation").partition(":")[2])
    assert 0 < deviation < 0.005  # of 200 samples with noise of 0.01 m
    assert output("recipes.md", "kept:") == "kept: True True"
    assert "There is no parameter 'stiffness'." in output("recipes.md", "There is no")


# The text. ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", RUN_HERE)
def test_the_page_is_in_plain_english(page):
    prose = architecture_words.prose_of_markdown(text_of(page))
    reported = list(architecture_words.banned_prose(prose))
    assert not reported, "\n".join(f"{page}:{line}: {words}" for line, words in reported)


@pytest.mark.parametrize("page", PAGES)
def test_names_in_the_text_exist(page):
    """Dotted names of the package, of its modules by their short names, and of an estimate."""
    names = re.findall(r"\bjaxid(?:\.\w+)+", text_of(page))
    for module in ("design", "uncertainty", "structure", "smoothing"):
        used = re.findall(rf"(?<![\w.]){module}\.(\w+)\(", text_of(page))
        names += [f"jaxid.{module}.{name}" for name in used]
    names += [f"jaxid.Estimate.{name}" for name in re.findall(r"\bfit\.(\w+)", text_of(page))]
    missing = sorted(name for name in set(names) if not _exists(name))
    assert not missing


def _exists(name: str) -> bool:
    parts = name.split(".")
    known = module_of("jaxid.aircraft") if parts[1] == "aircraft" else module_of("jaxid")
    for part in parts[2 if parts[1] == "aircraft" else 1 :]:
        if not hasattr(known, part):
            return part in getattr(known, "__annotations__", {})
        known = getattr(known, part)
    return True


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = {file.relative_to(DOCS).as_posix() for file in DOCS.rglob("*.md")}
    pages |= {f"notebooks/{name}.md" for name in NOTEBOOKS}
    missing = {page for page in pages if f"- {page}\n" not in navigation}
    assert not missing


def test_the_gallery_lists_every_notebook():
    listed = re.findall(
        r"^\| \[[^]]+\]\(\.\./notebooks/(\w+)\.ipynb\)", text_of("notebooks.md"), re.M
    )
    assert listed == NOTEBOOKS


# The API reference. -------------------------------------------------------------------------------


def entry(module: str, name: str) -> str:
    """Return the text that documents a public name on the page of its module."""
    public, path = f"{module}.{name}", definition(module, name)
    if isinstance(getattr(module_of(module), name), types.ModuleType):
        return f"- [`{public}`]({name}.md)"
    if module != "jaxid" and name in public_names("jaxid") and definition("jaxid", name) == path:
        return f"- [`{public}`](index.md#{path}) is `jaxid.{name}`."
    return f"::: {path}\n    options: {{heading: {public}, toc_label: {name}}}"


@pytest.mark.parametrize("module", MODULES)
def test_every_public_name_is_in_the_api_reference(module):
    page = text_of(page_of(module))
    missing = [text for name in public_names(module) if (text := entry(module, name)) not in page]
    assert not missing, "\n\n".join([f"Add to docs/{page_of(module)}:", *missing])


@pytest.mark.parametrize("module", MODULES)
def test_the_api_reference_has_no_other_entries(module):
    known = {definition(module, name) for name in public_names(module)}
    listed = re.findall(r"^::: (\S+)$", text_of(page_of(module)), flags=re.MULTILINE)
    assert len(listed) == len(set(listed))
    assert set(listed) <= known


@pytest.mark.parametrize("module", [module for module in MODULES if module != "jaxid"])
def test_the_page_of_a_module_states_how_it_is_imported(module):
    states = f"`import {module}` fails" in text_of(page_of(module))
    assert states == (importlib.util.find_spec(module) is None)


def test_every_public_module_of_the_package_has_a_page():
    package = module_of("jaxid")
    modules = {
        f"jaxid.{name}"
        for name in public_names("jaxid")
        if isinstance(getattr(package, name), types.ModuleType)
    }
    assert modules <= set(MODULES)


# The examples. ------------------------------------------------------------------------------------

# Names without an example; a name leaves the list with its first one. The list must not grow.
WITHOUT_EXAMPLE = {
    "jaxid.models": {"Parameters"},
    # costs inside `design_input` and `expected_chi_square`
    "jaxid.design": {
        *("Discrimination", "InformationObjective", "MutualDiscrimination", "RobustObjective"),
    },
    # the processes of `close_loop_many` need a script with a main guard
    "jaxid.study": {"Studies", "StudyResult", "close_loop_many", "next_record", "separating_input"},
}


@pytest.fixture(scope="module")
def examples():
    """Paths of the definitions that the code run by the tests shows (`shown_names`)."""
    texts = [text_of(page) for page in (*RUN_HERE[1:], *RUN_ELSEWHERE)]
    texts.append((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))  # test_contributing.py
    code = ["\n".join(blocks(text, "python")) for text in texts]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code.append(blocks(readme, "python")[0])  # test_readme.py
    for name in NOTEBOOKS:  # test_notebooks.py
        notebook = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
        code.append("\n".join(one.source for one in notebook.cells if one.cell_type == "code"))
    return shown_definitions("\n".join(blocks(text_of(START), "python")), code)


def test_code_shows_names_results_and_abstract_bases_but_no_imports():
    page = "from jaxid import Adaptive, hold\njaxid.estimate\nhold.Cubic()"
    paths = shown_definitions("import jaxid", [page])
    names = {path.rpartition(".")[2] for path in paths}
    assert {"estimate", "Estimate", "Cubic", "AbstractHold"} <= names
    assert not names & {"Adaptive", "ZeroOrder", "predict"}


@pytest.mark.parametrize("module", MODULES)
def test_every_public_name_has_an_example_that_runs(module, examples):
    without = {name for name in public_names(module) if definition(module, name) not in examples}
    assert without == WITHOUT_EXAMPLE.get(module, set())


# Pages from files outside of the folder. ----------------------------------------------------------


def hook(name: str) -> types.ModuleType:
    """Return a module of the folder `docs`."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def page_text():
    return hook("hooks").page_text


@pytest.mark.parametrize(
    ("page", "link", "translated"),
    [
        ("overview.md", "[effects](docs/effects.md)", "[effects](effects.md)"),
        ("overview.md", "![A study](docs/study.png)", "![A study](study.png)"),
        ("overview.md", "[`map`](jaxid/README.md)", "[`map`](map.md)"),
        ("overview.md", "[Notebooks](notebooks)", "Notebooks"),
        ("map.md", "[flights](../docs/flights.md#a)", "[flights](flights.md#a)"),
        ("effects.md", "[guide](../CONTRIBUTING.md)", "[guide](contributing.md)"),
        (
            "recipes.md",
            "[01](../notebooks/01_quick_start.ipynb)",
            "[01](notebooks/01_quick_start.md)",
        ),
        ("notebooks/02b_departure.md", "[03](03_structure.ipynb)", "[03](03_structure.md)"),
        ("notebooks/02b_departure.md", "![a](02b_departure_files/b.png)", None),
        ("api/effects.md", "[table](../effects.md)", "[table](../effects.md)"),
        ("index.md", "[here](#fit), [there](https://a.org/b)", None),
        ("contributing.md", "```python\ntests[0](seed)\n```\n`tests[0](seed)`", None),
    ],
)
def test_links_to_files_become_links_to_pages(page, link, translated, page_text):
    assert page_text(link, page) == (link if translated is None else translated)


def test_sections_of_the_readme_are_inserted(page_text):
    shown = page_text(text_of(START), START)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert blocks(readme, "python")[0] in shown
    assert blocks(readme, "bash")[0] in shown
    assert "<!-- README" not in shown


# The notebooks. -----------------------------------------------------------------------------------


@pytest.fixture
def notebook_pages(tmp_path, monkeypatch):
    pages = hook("notebook_pages")
    monkeypatch.setattr(pages, "CACHE", tmp_path / "cache")
    return pages


def test_an_executed_notebook_is_kept_until_it_changes(notebook_pages, tmp_path):
    path, runs = tmp_path / "count.ipynb", tmp_path / "runs"
    cell = "with open({!r}, 'a') as runs: print(runs.write({!r}))"

    def output(mark):
        code = nbformat.v4.new_code_cell(cell.format(str(runs), mark), id="a")
        nbformat.write(nbformat.v4.new_notebook(cells=[code]), path)
        return notebook_pages.executed(path).cells[0].outputs[0].text

    assert [output("a"), output("a"), output("bb")] == ["1\n", "1\n", "2\n"]
    assert runs.read_text(encoding="utf-8") == "abb"


@pytest.mark.parametrize(
    ("pattern", "selected"), [("*", slice(None)), ("01*", slice(1)), ("", slice(0))]
)
def test_pattern_selects_notebooks_to_execute(notebook_pages, monkeypatch, pattern, selected):
    config = pytest.importorskip("mkdocs.config")
    executed, names = [], sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb"))
    monkeypatch.setenv("EXECUTE_NOTEBOOKS", pattern)
    monkeypatch.setattr(notebook_pages, "executed", lambda path: executed.append(path.stem))
    monkeypatch.setattr(notebook_pages, "page_with_figures", lambda notebook, name: {})
    notebook_pages.on_files([], config.load_config(str(ROOT / "mkdocs.yml")))
    assert executed == names[selected]


def test_the_page_of_a_notebook_has_its_outputs(notebook_pages):
    if not all(importlib.util.find_spec(name) for name in ("nbconvert", "latex2mathml")):
        pytest.skip('nbconvert is not installed: pip install -e ".[docs]"')
    code = nbformat.v4.new_code_cell("fit")
    png = base64.b64encode(b"a figure").decode()
    data = {"text/html": "<pre>", "text/plain": "k  2.0"}
    code.outputs = [
        nbformat.v4.new_output("stream", text="weak: [k](c)\n"),
        nbformat.v4.new_output("execute_result", data=data),
        nbformat.v4.new_output("display_data", data={"image/png": png, "text/plain": "<Figure>"}),
        nbformat.v4.new_output("display_data", data={"text/plain": ""}),  # of ended progress
    ]
    text = nbformat.v4.new_markdown_cell("# Title\nText $x_1$ and `$HOME`, `$PATH`.")
    page, figure = notebook_pages.page_with_figures(
        nbformat.v4.new_notebook(cells=[text, code]), "01"
    ).items()
    assert figure == ("01_files/01_1_2.png", b"a figure")
    assert page[0] == "01.md"
    for shown in ("weak: [k](c)", "k  2.0"):
        assert f'```text title="Output"\n{shown}\n```' in page[1]
    assert "![Figure of the code above](01_files/01_1_2.png)" in page[1]
    assert "<pre>" not in page[1]
    assert "<Figure>" not in page[1]
    assert page[1].count('title="Output"') == 2
    assert "<msub><mi>x</mi><mn>1</mn></msub>" in page[1]
    assert "`$HOME`, `$PATH`" in page[1]


# The build. ---------------------------------------------------------------------------------------


def test_mkdocs_builds_the_site_without_a_warning(tmp_path):
    """Pages need no network: no script, style, font or image comes from another server. No list or
    table is left as text.
    """
    needed = ("mkdocs", "material", "mkdocstrings", "nbconvert", "latex2mathml")
    if not all(importlib.util.find_spec(name) for name in needed):
        pytest.skip('mkdocs is not installed: pip install -e ".[docs]"')
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    loaded = re.compile(r"""<(?:script|img|source|iframe)[^>]*\ssrc=["']?(?:https?:)?//""")
    linked = re.compile(r"""<link[^>]*rel=["']?(?:stylesheet|preload|preconnect)[^>]*//""")
    for page in tmp_path.rglob("*.html"):
        html = page.read_text(encoding="utf-8")
        assert not loaded.search(html), page
        assert not linked.search(html), page
        prose = re.sub(r"<(pre|code)\b.*?</\1>", "", html, flags=re.DOTALL)
        markup = re.compile(r"^\s*(?:- |\d+\. |\| |#+ |```)", re.MULTILINE)
        assert not markup.search(re.sub(r"<[^>]+>", "", prose)), page  # a list that is none
