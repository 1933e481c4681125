"""The rules of the house hold, and each rule is shown to bite."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import architecture
import architecture_words
import pytest

ROOT = Path(__file__).resolve().parent.parent


def test_the_house_keeps_its_rules():
    reported = architecture.breaches(ROOT / "jaxid")
    assert not reported, "\n".join(["", *reported])


@pytest.mark.parametrize("folder", ["tests", "benchmarks"])
def test_lines_of_tests_and_benchmarks_are_short(folder):
    reported = [
        f"{file.relative_to(ROOT)}:{line}: {words}"
        for file in sorted((ROOT / folder).rglob("*.py"))
        for line, words in architecture_words.long_lines(file.read_text(encoding="utf-8"))
    ]
    assert not reported, "\n".join(["", *reported])


def test_files_of_tests_have_names_of_their_own():
    """Python imports test files by name alone: a second one of that name is not collected."""
    names = [file.name for file in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def test_counted_words_are_rare_in_documents():
    files = [
        ROOT / "README.md",
        ROOT / "jaxid" / "README.md",
        *sorted((ROOT / "docs").rglob("*.md")),
    ]
    passages = [
        passage
        for file in files
        for passage in architecture_words.prose_of_markdown(file.read_text(encoding="utf-8"))
    ]
    assert not architecture_words.too_dense(passages)


# A package that keeps every rule; the breaches below are planted in copies of it. -----------------

CLEAN = {
    "__init__.py": '"""A package."""\n\n'
    'from .study.identify import identify\n\n__all__ = ["identify"]\n',
    "__main__.py": "from ._foundation.configuration import configure\n"
    "from .aircraft.flight.fly import fly\nfrom .report.table import table\n\n"
    "configure()\n"
    'print(table(fly()))\nopen("out.txt", "w").close()\n',
    "_foundation/__init__.py": "",
    "_foundation/checks.py": "import jax\n\n\ndef wide():\n    return jax.config.jax_enable_x64\n",
    "_foundation/configuration.py": "import os\n\nimport jax\n\n\n"
    "def configure():\n"
    '    os.makedirs("cache")\n    jax.config.update("jax_enable_x64", True)\n',
    "_foundation/results.py": "import optimistix as optx\n\nRESULTS = optx.RESULTS\n",
    "data/__init__.py": "",
    "data/record.py": "import numpy as np\n\n\n"
    "def draw(seed):\n    return np.random.default_rng(seed).normal()\n",
    "data/io/csv.py": "import pandas as pd\n\n\ndef read(path):\n    return pd.read_csv(path)\n",
    "models/__init__.py": "",
    "models/base.py": "import equinox as eqx\n\n"
    "from ..data.record import draw\n\nBase = (eqx.Module, draw)\n",
    "effects/__init__.py": "",
    "effects/base.py": "from ..models.base import Base\n\nEffect = Base\n",
    "simulation/__init__.py": "",
    "simulation/simulate.py": "import diffrax\nimport optimistix\n\n"
    "from ..models.base import Base\n",
    "sensitivity/__init__.py": "",
    "estimation/__init__.py": "",
    "estimation/solver.py": "import lineax as lx\nfrom jax import random\n\nkey = random.key\n",
    "structure/__init__.py": "",
    "diagnosis/__init__.py": "",
    "design/__init__.py": "",
    "study/__init__.py": "",
    "study/identify.py": "from ..diagnosis import residual\nfrom . import loop\n\n"
    "identify = residual, loop\n",
    "report/__init__.py": "",
    "report/table.py": "import jinja2\nimport matplotlib.pyplot as plt\n\n\n"
    "def table():\n    plt.savefig('a')\n",
    "aircraft/__init__.py": "",
    "aircraft/vehicle/__init__.py": "",
    "aircraft/vehicle/engine.py": "from ...effects.base import Effect\n",
    "aircraft/flight/__init__.py": "",
    "aircraft/flight/fly.py": "from ...simulation.simulate import Base\n"
    "from ..vehicle import engine\n\nfly = Base, engine\n",
}

LONG_FUNCTION = 'def long():\n    """Short words."""\n' + "    x = 0\n" * 81
LONG_DOCSTRING = (
    'def described():\n    """Words.\n'
    + "    More words.\n" * 100
    + '    """\n'
    + "    x = 0\n" * 80
)


LONG_LINE = "x = " + " + ".join(["speed"] * 13)
COMPLEX = "def complex_block(x):\n" + "    if x: pass\n" * 20
COMPLEX_BLOCKS = "".join(
    f"def block_{number}(x):\n" + "    if x: pass\n" * 10 for number in range(11)
)
BACK = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .record import draw"


class Plant(NamedTuple):
    """A breach: this text at the end of this file is reported by this rule with these words.

    `more` holds the texts at the ends of other files that are part of the breach.
    """

    rule: str
    file: str
    text: str
    words: str
    more: dict[str, str] = {}  # noqa: RUF012


PLANTS = [
    Plant(
        "floors",
        "data/record.py",
        "from ..models.free import free",
        "data imports models, which is not below it",
    ),
    Plant(
        "floors",
        "simulation/simulate.py",
        "from ..study import identify",
        "simulation imports study",
    ),
    Plant(
        "floors",
        "models/base.py",
        "def late():\n    from ..estimation import solver",
        "models imports estimation",
    ),
    Plant(
        "floors", "diagnosis/__init__.py", "from ..design import inputs", "diagnosis imports design"
    ),
    Plant(
        "floors",
        "design/__init__.py",
        "from ..diagnosis import residual",
        "design imports diagnosis",
    ),
    Plant(
        "floors",
        "aircraft/flight/fly.py",
        "from ...estimation import solver",
        "aircraft imports estimation",
    ),
    Plant(
        "floors",
        "aircraft/flight/fly.py",
        "from ...sensitivity import jacobian",
        "aircraft imports sensitivity",
    ),
    Plant("floors", "attic/old.py", "pass", "attic is on no floor"),
    Plant("floors", "models/base.py", "from ..effects.card import Card", "models imports effects"),
    Plant(
        "floors", "effects/base.py", "from ..simulation import trim", "effects imports simulation"
    ),
    Plant(
        "districts",
        "aircraft/vehicle/engine.py",
        "from ..flight.trims import trim",
        "vehicle imports flight",
    ),
    Plant(
        "districts",
        "aircraft/air/wind.py",
        "from ..instruments import noise",
        "air imports instruments",
    ),
    Plant(
        "districts", "aircraft/flight/fly.py", "from .. import vehicles", "vehicles is no district"
    ),
    Plant("districts", "aircraft/wings.py", "pass", "aircraft/wings.py is in no district"),
    Plant("districts", "aircraft/sea/waves.py", "pass", "aircraft/sea/waves.py is in no district"),
    Plant(
        "core_without_domain",
        "study/identify.py",
        "from ..aircraft.flight import fly",
        "core imports aircraft",
    ),
    Plant(
        "core_without_domain",
        "report/table.py",
        "from ..aircraft import flight",
        "core imports aircraft",
    ),
    Plant("core_without_domain", "__init__.py", "from . import aircraft", "core imports aircraft"),
    Plant(
        "nothing_imports_report",
        "study/identify.py",
        "from ..report.table import table",
        "only __main__ and methods `plot` import report",
    ),
    Plant(
        "nothing_imports_report",
        "aircraft/flight/fly.py",
        "from ...report import table",
        "only __main__ and methods `plot` import report",
    ),
    Plant(
        "nothing_imports_report",
        "__init__.py",
        "from .report.table import table",
        "only __main__ and methods `plot` import report",
    ),
    Plant(
        "nothing_imports_report",
        "models/base.py",
        "class Drawn:\n    def draw(self):\n        from ..report.table import table",
        "only __main__ and methods `plot` import report",
    ),
    Plant(
        "nothing_imports_report",
        "models/base.py",
        "def plot(x):\n    from ..report.table import table",
        "only __main__ and methods `plot` import report",
    ),
    Plant(
        "floors",
        "models/base.py",
        "class Drawn:\n    def plot(self):\n        from ..study.identify import identify",
        "models imports study, which is not below it",
    ),
    Plant("root", "study/identify.py", "import house", "absolute import of house"),
    Plant(
        "root",
        "study/identify.py",
        "from house.data.record import draw",
        "absolute import of house",
    ),
    Plant("root", "study/identify.py", "from .. import Record", "imports the package root"),
    Plant("root", "study/identify.py", "from .. import data", "imports the package root"),
    Plant("root", "__main__.py", "from . import identify", "imports the package root"),
    Plant("root", "__init__.py", "import house.data", "absolute import of house"),
    Plant(
        "homes", "estimation/solver.py", "import diffrax", "diffrax is imported only in simulation/"
    ),
    Plant(
        "homes",
        "simulation/simulate.py",
        "import lineax as lx",
        "lineax is imported only in estimation/",
    ),
    Plant(
        "homes",
        "_foundation/checks.py",
        "import optimistix",
        "optimistix is imported only in _foundation/results.py",
    ),
    Plant(
        "homes",
        "study/identify.py",
        "def plot():\n    import matplotlib.pyplot",
        "matplotlib is imported only in report/",
    ),
    Plant(
        "homes", "__main__.py", "from jinja2 import Template", "jinja2 is imported only in report/"
    ),
    Plant(
        "equations_without_solvers",
        "models/base.py",
        "import diffrax",
        "equations never import diffrax",
    ),
    Plant(
        "equations_without_solvers",
        "models/base.py",
        "from lineax import QR",
        "equations never import lineax",
    ),
    Plant(
        "equations_without_solvers",
        "aircraft/flight/fly.py",
        "import optimistix as o",
        "equations never import optimistix",
    ),
    Plant(
        "public_interfaces",
        "data/record.py",
        "from jax._src import core",
        "jax._src.core is not a public interface",
    ),
    Plant(
        "public_interfaces",
        "data/record.py",
        "from jax import _src",
        "jax._src is not a public interface",
    ),
    Plant(
        "public_interfaces",
        "data/record.py",
        "import jax\njax._src.core.f()",
        "jax._src.core.f is not a public",
    ),
    Plant(
        "public_interfaces",
        "models/base.py",
        "import equinox.internal as eqxi",
        "equinox.internal is not a public",
    ),
    Plant(
        "public_interfaces",
        "models/base.py",
        "x = eqx.internal.while_loop",
        "equinox.internal.while_loop is not",
    ),
    Plant(
        "public_interfaces",
        "estimation/solver.py",
        "from lineax._solver import qr",
        "lineax._solver.qr is not a public",
    ),
    Plant(
        "public_interfaces",
        "estimation/solver.py",
        "import optimistix._misc",
        "optimistix._misc is not a public",
    ),
    Plant(
        "public_interfaces",
        "simulation/simulate.py",
        "import diffrax._term",
        "diffrax._term is not a public",
    ),
    Plant(
        "no_config",
        "_foundation/checks.py",
        'jax.config.update("jax_enable_x64", True)',
        "jax.config.update: library",
    ),
    Plant(
        "no_config",
        "_foundation/checks.py",
        "jax.config.jax_enable_x64 = True",
        "leaves JAX's settings alone",
    ),
    Plant(
        "no_config",
        "__main__.py",
        'import jax\njax.config.update("jax_enable_x64", True)',
        "jax.config.update: library",
    ),
    Plant(
        "no_config",
        "study/identify.py",
        "from jax.experimental.compilation_cache import compilation_cache",
        "jax.experimental.compilation_cache.compilation_cache: library",
    ),
    Plant(
        "no_config",
        "estimation/solver.py",
        "from jax import config",
        "jax.config: library code leaves JAX's",
    ),
    Plant(
        "no_config",
        "study/identify.py",
        "import jax\nx = jax.config.jax_enable_x64",
        "leaves JAX's settings alone",
    ),
    Plant(
        "no_config",
        "study/identify.py",
        "from jax.experimental import enable_x64",
        "leaves JAX's settings alone",
    ),
    Plant("no_print", "study/identify.py", 'print("fitted")', "print: library code does not print"),
    Plant("no_print", "report/table.py", 'print("table")', "print: library code does not print"),
    Plant(
        "no_print",
        "estimation/solver.py",
        'import jax\njax.debug.print("x")',
        "jax.debug.print: library code",
    ),
    Plant(
        "no_global_random_state",
        "data/record.py",
        "np.random.seed(0)",
        "numpy.random.seed is global random state",
    ),
    Plant(
        "no_global_random_state",
        "data/record.py",
        "from numpy.random import normal",
        "numpy.random.normal is global",
    ),
    Plant(
        "no_global_random_state",
        "data/record.py",
        "from numpy import random as r\nr.rand()",
        "numpy.random.rand is",
    ),
    Plant(
        "no_global_random_state", "__main__.py", "import random", "random is global random state"
    ),
    Plant(
        "no_global_random_state",
        "data/record.py",
        "from random import gauss",
        "random.gauss is global random state",
    ),
    Plant(
        "no_files",
        "data/record.py",
        'text = open("a.csv").read()',
        "open: files are touched only in data/io",
    ),
    Plant(
        "no_files",
        "study/identify.py",
        "from pathlib import Path\nPath('a').write_text('b')",
        ".write_text(): files",
    ),
    Plant(
        "no_files",
        "study/identify.py",
        "from pathlib import Path\nPath('a').read_text()",
        ".read_text(): files are",
    ),
    Plant(
        "no_files",
        "study/identify.py",
        "from pathlib import Path\nPath('a').mkdir()",
        ".mkdir(): files are touched",
    ),
    Plant(
        "no_files",
        "models/base.py",
        "import pandas as pd\npd.read_csv('a')",
        "pandas.read_csv: files are touched",
    ),
    Plant(
        "no_files",
        "study/identify.py",
        "def save(frame):\n    frame.to_csv('a')",
        ".to_csv(): files are touched",
    ),
    Plant("no_files", "data/record.py", "np.load('a')", "numpy.load: files are touched only in"),
    Plant(
        "no_files",
        "data/record.py",
        "np.savetxt('a', [0])",
        "numpy.savetxt: files are touched only in",
    ),
    Plant(
        "no_files",
        "aircraft/flight/fly.py",
        "import scipy.io",
        "scipy.io: files are touched only in",
    ),
    Plant(
        "no_files",
        "aircraft/flight/fly.py",
        "from scipy.io import loadmat",
        "scipy.io.loadmat: files are touched",
    ),
    Plant(
        "face_without_code",
        "__init__.py",
        "VERSION = 1",
        "holds only its docstring, imports and __all__",
    ),
    Plant(
        "face_without_code",
        "__init__.py",
        "def helper(): ...",
        "holds only its docstring, imports and __all__",
    ),
    Plant(
        "short_functions",
        "models/base.py",
        LONG_FUNCTION,
        "the body of long has 81 lines; the limit is 80",
    ),
    Plant("short_files", "models/base.py", "x = 0\n" * 400, "the limit is 400"),
    *(
        Plant("banned_words", "models/base.py", text, words)
        for text, words in (
            ("def tried(): ...", "name tried: 'tried', participle"),
            ("class GroundWay: ...", "name GroundWay: 'way', metaphor"),
            ("LARGEST_HATS = 3", "name LARGEST_HATS: 'hats', metaphor"),
            ("def check(a, *, is_whole): ...", "name is_whole: 'whole', quantity"),
            ("def check(self):\n    self.kin = 1", "name kin: 'kin', metaphor"),
            ("import numpy as bench", "name bench: 'bench', metaphor"),
            ("[told for told in ()]", "name told: 'told', participle"),
            ("try: ...\nexcept ValueError as seen: ...", "name seen: 'seen', participle"),
            ("# The model says it.", "'says': verb of speech"),
            ("x = 1  # asked for", "'asked': verb of speech"),
            ('"""Runs anew."""', "'anew': not plain English"),
            ("# One of\n# the hats.", "'hats': metaphor"),
            ('def f():\n    """Return what\n    the model holds."""', "'what the': noun clause"),
            ("# A signal of which a term is made.", "'of which': needs a sentence"),
            ('def f():\n    """That of the sensors."""', "'That of': pronoun"),
            ("# Two noises. Those of sensors.", "'Those of': pronoun"),
        )
    ),
    Plant("banned_words", "models/tried.py", "pass", "name tried: 'tried', participle"),
    Plant("banned_words", "quickly/__init__.py", "pass", "name quickly: 'quickly', adverb"),
    Plant(
        "long_lines", "models/base.py", LONG_LINE, "the line has 105 characters; the limit is 100"
    ),
    Plant("long_lines", "models/base.py", f"# {'word ' * 20}", "characters; the limit is 100"),
    Plant(
        *("file_cycles", "data/record.py", "from .units import unit"),
        "data/record.py -> data/units.py -> data/record.py",
        {"data/units.py": BACK},
    ),
    Plant(
        *("file_cycles", "data/a.py", "from .b import x"),
        "cycle of files: data/a.py -> data/b.py -> data/c.py -> data/a.py",
        {"data/b.py": "from . import c", "data/c.py": "def late():\n    from .a import x"},
    ),
    Plant("file_cycles", "data/a.py", "from .a import x", "cycle of files: data/a.py -> data/a.py"),
    Plant(
        *(
            "crowded_folders",
            "data/z.py",
            "pass",
            "the folder data has 21 modules; the limit is 20",
        ),
        {f"data/m{number}.py": "" for number in range(19)},
    ),
    Plant(
        *("one_value_per_constant", "simulation/simulate.py", "LIMIT = 2.0"),
        "LIMIT is 2.0 here and 1.0 in data/record.py:6",
        {"data/record.py": "LIMIT = 1.0"},
    ),
    Plant(
        *("one_value_per_constant", "simulation/simulate.py", "LEAST, _MOST = 1, 3"),
        "_MOST is 3 here and 2 in data/record.py:6",
        {"data/record.py": "LEAST: int = 1; _MOST = 2"},
    ),
    Plant("complexity", "models/base.py", COMPLEX, "of complex_block is 21; the limit is 20"),
    Plant("complexity", "models/base.py", COMPLEX_BLOCKS, "block_0 (11) is one of 11 blocks"),
    Plant("dense_words", "models/base.py", "# What else.", "what: 1 in"),
    Plant("dense_words", "models/base.py", "# The rules say.", "speech: 1 in"),
]


def build(folder: Path, extra: dict[str, str], base: dict[str, str] = CLEAN) -> Path:
    """Write the package `house` into the folder: the base files, each with its extra text."""
    package = folder / "house"
    for name in base.keys() | extra.keys():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(base.get(name, "") + extra.get(name, ""))
    return package


def test_the_clean_package_passes(tmp_path):
    assert architecture.breaches(build(tmp_path, {"models/base.py": LONG_DOCSTRING})) == []


@pytest.mark.parametrize("plant", PLANTS, ids=lambda plant: f"{plant.rule}-{plant.words[:40]}")
def test_a_planted_breach_is_reported(plant, tmp_path):
    planted = {plant.file: plant.text, **plant.more}
    reported = architecture.breaches(build(tmp_path, planted))
    places = []
    for file, text in planted.items():
        start = len(CLEAN.get(file, "").splitlines())
        lines = range(start + 1, start + 1 + len(text.splitlines()))
        if plant.words.endswith("on no floor"):
            lines = range(1, 2)
        places += [f"house/{file}:{line}: " for line in lines]
    named = [text for text in reported if plant.words in text and text.endswith(f"[{plant.rule}]")]
    assert named, f"{plant.rule} did not report it; reported {reported}"
    assert all(text.startswith(tuple(places)) for text in reported), reported


def test_every_rule_has_a_planted_breach():
    rules = (*architecture.RULES, *architecture.HOUSE_RULES)
    assert {plant.rule for plant in PLANTS} == {rule.__name__ for rule in rules}


# Borders of the rules on words, lines and constants. ----------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "# The root is found by bisection, and each record is corrected in turn.",
        "# The term `what is told` is code, and masks, tasks and akin besides it are no breach.",
        "# The noise: that of the sensors.",
        "def always(runway, qhat): ...",
        "import numpy.told",
        f"x = [\n    {'0.125, -1e-3, ' * 12}\n]",
        f"# Source: https://example.org/{'page/' * 20}",
    ],
)
def test_plain_text_is_no_breach(text, tmp_path):
    assert architecture.breaches(build(tmp_path, {"models/base.py": text})) == []


def test_a_method_plot_may_import_report(tmp_path):
    """Also where `report` imports the file of the method."""
    method = "class Drawn:\n    def plot(self):\n        from ..report.table import table"
    planted = {"models/base.py": method, "report/table.py": "from ..models.base import Drawn\n"}
    assert architecture.breaches(build(tmp_path, planted)) == []


def test_one_value_in_two_files_is_no_breach(tmp_path):
    planted = {"data/record.py": "LIMIT = 1.0\n", "models/base.py": "LIMIT: float = 1.0\n"}
    assert architecture.breaches(build(tmp_path, planted)) == []


def test_a_dense_document_is_reported():
    text = "What is this?\n```\nwhat\n```\n`told` and <!-- told --> [tell](what.md)\n"
    reported = architecture_words.too_dense(architecture_words.prose_of_markdown(text))
    assert set(reported) == {"what", "speech"}
    assert reported["what"].startswith("what: 1 in 5 words")
    assert reported["speech"].startswith("speech: 1 in 5 words")


def test_the_command_reports_breaches_counts_and_density(tmp_path):
    folder = tmp_path / "jaxid" / "study"
    folder.mkdir(parents=True)
    (folder / "study.py").write_text("# It says\n# what is\n# asked.\n\nkin = 1\n")
    (folder / "search.py").write_text(f"search = 1\n{LONG_LINE}\n")
    (folder / "notes.md").write_text("Plain words.\n")
    lines = architecture_words.report([str(folder)])
    assert lines[:5] == [
        f"{folder}/search.py:2: the line has 105 characters; the limit is 100 [lines]",
        f"{folder}/study.py:1: 'says': verb of speech [prose]",
        f"{folder}/study.py:2: 'what is': noun clause in place of a noun [prose]",
        f"{folder}/study.py:3: 'asked': verb of speech [prose]",
        f"{folder}/study.py:5: name kin: 'kin', metaphor [names]",
    ]
    assert f"     4  {folder}/study.py  (1 names, 3 prose)" in lines
    assert f"     1  {folder}/search.py  (1 lines)" in lines
    assert "     5  in all 3 files  (1 lines, 1 names, 3 prose)" in lines
    assert any("what 2000.0 (1; under 10), speech 4000.0 (2; under 1)" in line for line in lines)


# Importing changes nothing. -----------------------------------------------------------------------

PROBE = """
import importlib, json, os, pkgutil, sys, warnings

name, dependencies = sys.argv[1], sys.argv[2:]
for dependency in dependencies:
    importlib.import_module(dependency)
import jax, numpy

def settings():
    reported = {f"jax.config.{key}": repr(value) for key, value in jax.config.values.items()}
    random_state = [numpy.asarray(part).tolist() for part in numpy.random.get_state()]
    reported["numpy.random"] = repr(random_state)
    reported["numpy.errors"] = repr((numpy.geterr(), numpy.get_printoptions()))
    reported["warnings.filters"] = repr(warnings.filters)
    reported["environment"] = repr(dict(os.environ))
    if "matplotlib" in sys.modules:
        import matplotlib
        reported["matplotlib.backend"] = repr(matplotlib.get_backend(auto_select=False))
        parameters = matplotlib.rcParams
        kept = {key: parameters[key] for key in parameters if key != "backend"}
        reported["matplotlib.rcParams"] = repr(kept)
    return reported

def changes(before, after):
    return sorted(key for key in before.keys() | after.keys() if before.get(key) != after.get(key))

before, imported = settings(), set(sys.modules)
package = importlib.import_module(name)
changed = changes(before, settings())
slow = ["matplotlib", "jinja2"]
slow += ["scipy.interpolate", "scipy.optimize", "scipy.signal", "scipy.stats"]
changed += [f"import of {module}" for module in slow if module in sys.modules.keys() - imported]

import matplotlib.pyplot
before = settings()
for module in pkgutil.walk_packages(package.__path__, name + "."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
changed += changes(before, settings())
print(json.dumps(changed))
"""
DEPENDENCIES = (
    "jax",
    "equinox",
    "lineax",
    "optimistix",
    "diffrax",
    "interpax",
    "pandas",
    "xarray",
    "pint",
)


def changes_on_import(folder: Path, name: str, dependencies: tuple[str, ...]) -> list[str]:
    """Changes by an import of the package and then of each module, in a fresh interpreter.

    The dependencies are imported before; matplotlib, jinja2 and the slow modules of SciPy are a
    change if the package imports them.

    The platform given to JAX does not exist, so a module that makes an array while it is imported
    fails: the array would start the device and would keep the precision of that moment.
    """
    environment = {**os.environ, "PYTHONPATH": str(folder), "JAX_PLATFORMS": "none_such"}
    environment.pop("MPLBACKEND", None)  # so that a module that chooses one is seen
    command = [sys.executable, "-c", PROBE, name, *dependencies]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_importing_changes_nothing():
    assert changes_on_import(ROOT, "jaxid", DEPENDENCIES) == []


IMPORTABLE = {
    "__init__.py": "",
    "data/__init__.py": "",
    "data/record.py": CLEAN["data/record.py"],
    "report/__init__.py": "",
    "report/table.py": CLEAN["report/table.py"],
}
IMPORT_PLANTS = [
    (
        "__init__.py",
        'import jax\njax.config.update("jax_enable_x64", True)',
        "jax.config.jax_enable_x64",
    ),
    ("data/record.py", "np.random.seed(1)", "numpy.random"),
    ("data/record.py", 'np.seterr(all="raise")', "numpy.errors"),
    ("__init__.py", "import warnings\nwarnings.simplefilter('ignore')", "warnings.filters"),
    ("__init__.py", "import os\nos.environ['XLA_FLAGS'] = ''", "environment"),
    ("__init__.py", "import matplotlib", "import of matplotlib"),
    ("__init__.py", "import scipy.stats", "import of scipy.stats"),
    ("report/table.py", "import matplotlib\nmatplotlib.use('agg')", "matplotlib.backend"),
    ("report/table.py", "plt.rcParams['lines.linewidth'] = 9", "matplotlib.rcParams"),
]


def test_importing_the_clean_package_changes_nothing(tmp_path):
    build(tmp_path, {}, IMPORTABLE)
    assert changes_on_import(tmp_path, "house", ("jax",)) == []


@pytest.mark.parametrize(
    ("file", "text", "word"), IMPORT_PLANTS, ids=[plant[2] for plant in IMPORT_PLANTS]
)
def test_a_change_on_import_is_reported(file, text, word, tmp_path):
    build(tmp_path, {file: text}, IMPORTABLE)
    assert word in changes_on_import(tmp_path, "house", ("jax",))


def test_an_array_made_on_import_is_reported(tmp_path):
    build(
        tmp_path, {"data/record.py": "import jax.numpy as jnp\n\nONE = jnp.ones(3)\n"}, IMPORTABLE
    )
    with pytest.raises(AssertionError, match="none_such"):
        changes_on_import(tmp_path, "house", ("jax",))
