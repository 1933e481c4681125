"""The rules of the house hold, and each rule is shown to bite."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import architecture
import pytest

ROOT = Path(__file__).resolve().parent.parent


def test_the_house_keeps_its_rules():
    found = architecture.breaches(ROOT / "jaxid")
    assert not found, "\n".join(["", *found])


# A package that keeps every rule; the breaches below are planted in copies of it. -------------------------------------

CLEAN = {
    "__init__.py": '"""A package."""\n\nfrom .study.identify import identify\n\n__all__ = ["identify"]\n',
    "__main__.py": "import jax\n\nfrom .aircraft.flight import fly\nfrom .report.table import table\n\n"
    'jax.config.update("jax_enable_x64", True)\nprint(table(fly()))\nopen("out.txt", "w").close()\n',
    "_foundation/__init__.py": "",
    "_foundation/checks.py": "import jax\n\n\ndef wide():\n    return jax.config.jax_enable_x64\n",
    "_foundation/results.py": "import optimistix as optx\n\nRESULTS = optx.RESULTS\n",
    "data/__init__.py": "",
    "data/record.py": "import numpy as np\n\n\ndef draw(seed):\n    return np.random.default_rng(seed).normal()\n",
    "data/io_csv.py": "import pandas as pd\n\n\ndef read(path):\n    return pd.read_csv(path)\n",
    "models/__init__.py": "",
    "models/base.py": "import equinox as eqx\n\nfrom ..data.record import draw\n\nBase = (eqx.Module, draw)\n",
    "simulation/__init__.py": "",
    "simulation/simulate.py": "import diffrax\nimport optimistix\n\nfrom ..models.base import Base\n",
    "sensitivity/__init__.py": "",
    "estimation/__init__.py": "",
    "estimation/solver.py": "import lineax as lx\nfrom jax import random\n\nkey = random.key\n",
    "structure/__init__.py": "",
    "diagnosis/__init__.py": "",
    "design/__init__.py": "",
    "study/__init__.py": "",
    "study/identify.py": "from ..diagnosis import residual\nfrom . import loop\n\nidentify = residual, loop\n",
    "report/__init__.py": "",
    "report/table.py": "import jinja2\nimport matplotlib.pyplot as plt\n\n\ndef table():\n    plt.savefig('a')\n",
    "aircraft/__init__.py": "",
    "aircraft/flight.py": "from ..simulation.simulate import Base\nfrom . import engine\n\nfly = Base, engine\n",
}

LONG_FUNCTION = 'def long():\n    """Short words."""\n' + "    x = 0\n" * 81
LONG_DOCSTRING = 'def described():\n    """Words.\n' + "    More words.\n" * 100 + '    """\n' + "    x = 0\n" * 80


class Plant(NamedTuple):
    """A breach: this text, put at the end of this file, is reported by this rule with these words."""

    rule: str
    file: str
    text: str
    words: str


PLANTS = [
    Plant("floors", "data/record.py", "from ..models.base import Base", "data imports models, which is not below it"),
    Plant("floors", "simulation/simulate.py", "from ..study import identify", "simulation imports study"),
    Plant("floors", "models/base.py", "def late():\n    from ..estimation import solver", "models imports estimation"),
    Plant("floors", "diagnosis/__init__.py", "from ..design import inputs", "diagnosis imports design"),
    Plant("floors", "design/__init__.py", "from ..diagnosis import residual", "design imports diagnosis"),
    Plant("floors", "aircraft/flight.py", "from ..estimation import solver", "aircraft imports estimation"),
    Plant("floors", "aircraft/flight.py", "from ..sensitivity import jacobian", "aircraft imports sensitivity"),
    Plant("floors", "attic/old.py", "pass", "attic is on no floor"),
    Plant("core_without_domain", "study/identify.py", "from ..aircraft.flight import fly", "core imports aircraft"),
    Plant("core_without_domain", "report/table.py", "from ..aircraft import flight", "core imports aircraft"),
    Plant("core_without_domain", "__init__.py", "from . import aircraft", "core imports aircraft"),
    Plant(
        "nothing_imports_report",
        "study/identify.py",
        "from ..report.table import table",
        "only __main__ imports report",
    ),
    Plant("nothing_imports_report", "aircraft/flight.py", "from ..report import table", "only __main__ imports report"),
    Plant("nothing_imports_report", "__init__.py", "from .report.table import table", "only __main__ imports report"),
    Plant("root", "study/identify.py", "import house", "absolute import of house"),
    Plant("root", "study/identify.py", "from house.data.record import draw", "absolute import of house"),
    Plant("root", "study/identify.py", "from .. import Record", "imports the package root"),
    Plant("root", "study/identify.py", "from .. import data", "imports the package root"),
    Plant("root", "__main__.py", "from . import identify", "imports the package root"),
    Plant("root", "__init__.py", "import house.data", "absolute import of house"),
    Plant("homes", "estimation/solver.py", "import diffrax", "diffrax is imported only in simulation/"),
    Plant("homes", "simulation/simulate.py", "import lineax as lx", "lineax is imported only in estimation/"),
    Plant(
        "homes", "_foundation/checks.py", "import optimistix", "optimistix is imported only in _foundation/results.py"
    ),
    Plant(
        "homes",
        "study/identify.py",
        "def plot():\n    import matplotlib.pyplot",
        "matplotlib is imported only in report/",
    ),
    Plant("homes", "__main__.py", "from jinja2 import Template", "jinja2 is imported only in report/"),
    Plant("equations_without_solvers", "models/base.py", "import diffrax", "equations never import diffrax"),
    Plant("equations_without_solvers", "models/base.py", "from lineax import QR", "equations never import lineax"),
    Plant(
        "equations_without_solvers", "aircraft/flight.py", "import optimistix as o", "equations never import optimistix"
    ),
    Plant(
        "public_interfaces", "data/record.py", "from jax._src import core", "jax._src.core is not a public interface"
    ),
    Plant("public_interfaces", "data/record.py", "from jax import _src", "jax._src is not a public interface"),
    Plant("public_interfaces", "data/record.py", "import jax\njax._src.core.f()", "jax._src.core.f is not a public"),
    Plant("public_interfaces", "models/base.py", "import equinox.internal as eqxi", "equinox.internal is not a public"),
    Plant("public_interfaces", "models/base.py", "x = eqx.internal.while_loop", "equinox.internal.while_loop is not"),
    Plant(
        "public_interfaces",
        "estimation/solver.py",
        "from lineax._solver import qr",
        "lineax._solver.qr is not a public",
    ),
    Plant("public_interfaces", "estimation/solver.py", "import optimistix._misc", "optimistix._misc is not a public"),
    Plant("public_interfaces", "simulation/simulate.py", "import diffrax._term", "diffrax._term is not a public"),
    Plant(
        "no_config", "_foundation/checks.py", 'jax.config.update("jax_enable_x64", True)', "jax.config.update: library"
    ),
    Plant("no_config", "_foundation/checks.py", "jax.config.jax_enable_x64 = True", "leaves JAX's settings alone"),
    Plant("no_config", "estimation/solver.py", "from jax import config", "jax.config: library code leaves JAX's"),
    Plant("no_config", "study/identify.py", "import jax\nx = jax.config.jax_enable_x64", "leaves JAX's settings alone"),
    Plant("no_config", "study/identify.py", "from jax.experimental import enable_x64", "leaves JAX's settings alone"),
    Plant("no_print", "study/identify.py", 'print("fitted")', "print: library code does not print"),
    Plant("no_print", "report/table.py", 'print("table")', "print: library code does not print"),
    Plant("no_print", "estimation/solver.py", 'import jax\njax.debug.print("x")', "jax.debug.print: library code"),
    Plant("no_global_random_state", "data/record.py", "np.random.seed(0)", "numpy.random.seed is global random state"),
    Plant(
        "no_global_random_state", "data/record.py", "from numpy.random import normal", "numpy.random.normal is global"
    ),
    Plant(
        "no_global_random_state", "data/record.py", "from numpy import random as r\nr.rand()", "numpy.random.rand is"
    ),
    Plant("no_global_random_state", "__main__.py", "import random", "random is global random state"),
    Plant(
        "no_global_random_state", "data/record.py", "from random import gauss", "random.gauss is global random state"
    ),
    Plant("no_files", "data/record.py", 'text = open("a.csv").read()', "open: files are touched only in data/io"),
    Plant(
        "no_files", "study/identify.py", "from pathlib import Path\nPath('a').write_text('b')", ".write_text(): files"
    ),
    Plant(
        "no_files", "study/identify.py", "from pathlib import Path\nPath('a').read_text()", ".read_text(): files are"
    ),
    Plant(
        "no_files", "study/identify.py", "from pathlib import Path\nPath('a').mkdir()", ".mkdir(): files are touched"
    ),
    Plant("no_files", "models/base.py", "import pandas as pd\npd.read_csv('a')", "pandas.read_csv: files are touched"),
    Plant("no_files", "study/identify.py", "def save(frame):\n    frame.to_csv('a')", ".to_csv(): files are touched"),
    Plant("no_files", "data/record.py", "np.load('a')", "numpy.load: files are touched only in"),
    Plant("no_files", "data/record.py", "np.savetxt('a', [0])", "numpy.savetxt: files are touched only in"),
    Plant("no_files", "aircraft/flight.py", "import scipy.io", "scipy.io: files are touched only in"),
    Plant("no_files", "aircraft/flight.py", "from scipy.io import loadmat", "scipy.io.loadmat: files are touched"),
    Plant("face_without_code", "__init__.py", "VERSION = 1", "holds only its docstring, imports and __all__"),
    Plant("face_without_code", "__init__.py", "def helper(): ...", "holds only its docstring, imports and __all__"),
    Plant("short_functions", "models/base.py", LONG_FUNCTION, "the body of long has 81 lines; the limit is 80"),
    Plant("short_files", "models/base.py", "x = 0\n" * 400, "the limit is 400"),
]


def build(folder: Path, extra: dict[str, str], base: dict[str, str] = CLEAN) -> Path:
    """Write the package `house` into the folder: the base files, with the extra text at the end of some."""
    package = folder / "house"
    for name in base.keys() | extra.keys():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(base.get(name, "") + extra.get(name, ""))
    return package


def test_the_clean_package_passes(tmp_path):
    assert architecture.breaches(build(tmp_path, {"models/base.py": LONG_DOCSTRING})) == []


@pytest.mark.parametrize("plant", PLANTS, ids=lambda plant: f"{plant.rule}-{plant.words[:40]}")
def test_a_planted_breach_is_reported(plant, tmp_path):
    found = architecture.breaches(build(tmp_path, {plant.file: plant.text}))
    start = len(CLEAN.get(plant.file, "").splitlines())
    last = start + len(plant.text.splitlines())
    lines = range(1, 2) if plant.words.endswith("on no floor") else range(start + 1, last + 1)
    places = tuple(f"house/{plant.file}:{line}: " for line in lines)
    named = [text for text in found if plant.words in text and text.endswith(f"[{plant.rule}]")]
    assert named, f"{plant.rule} did not report it; found {found}"
    assert all(text.startswith(places) for text in found), found


def test_every_rule_has_a_planted_breach():
    assert {plant.rule for plant in PLANTS} == {rule.__name__ for rule in architecture.RULES}


# Importing changes nothing. -------------------------------------------------------------------------------------------

PROBE = """
import importlib, json, os, pkgutil, sys, warnings

name, dependencies = sys.argv[1], sys.argv[2:]
for dependency in dependencies:
    importlib.import_module(dependency)
import jax, numpy

def settings():
    found = {f"jax.config.{key}": repr(value) for key, value in jax.config.values.items()}
    found["numpy.random"] = repr([numpy.asarray(part).tolist() for part in numpy.random.get_state()])
    found["numpy.errors"] = repr((numpy.geterr(), numpy.get_printoptions()))
    found["warnings.filters"] = repr(warnings.filters)
    found["environment"] = repr(dict(os.environ))
    if "matplotlib" in sys.modules:
        import matplotlib
        found["matplotlib.backend"] = repr(matplotlib.get_backend(auto_select=False))
        parameters = matplotlib.rcParams
        found["matplotlib.rcParams"] = repr({key: parameters[key] for key in parameters if key != "backend"})
    return found

def changes(before, after):
    return sorted(key for key in before.keys() | after.keys() if before.get(key) != after.get(key))

before = settings()
package = importlib.import_module(name)
changed = changes(before, settings())
changed += [f"import of {plotter}" for plotter in ("matplotlib", "jinja2") if plotter in sys.modules]

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
    "scipy",
    "pandas",
    "xarray",
    "pint",
)


def changes_on_import(folder: Path, name: str) -> list[str]:
    """What an import of the package and then of each of its modules changes, told by a fresh interpreter.

    JAX is given a platform that does not exist, so that a module that makes an array while it is imported fails: the
    array would start the device and would keep the precision of that moment.
    """
    environment = {**os.environ, "PYTHONPATH": str(folder), "JAX_PLATFORMS": "none_such"}
    environment.pop("MPLBACKEND", None)  # so that a module that chooses one is seen
    command = [sys.executable, "-c", PROBE, name, *DEPENDENCIES]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_importing_changes_nothing():
    assert changes_on_import(ROOT, "jaxid") == []


IMPORTABLE = {
    "__init__.py": "",
    "data/__init__.py": "",
    "data/record.py": CLEAN["data/record.py"],
    "report/__init__.py": "",
    "report/table.py": CLEAN["report/table.py"],
}
IMPORT_PLANTS = [
    ("__init__.py", 'import jax\njax.config.update("jax_enable_x64", True)', "jax.config.jax_enable_x64"),
    ("data/record.py", "np.random.seed(1)", "numpy.random"),
    ("data/record.py", 'np.seterr(all="raise")', "numpy.errors"),
    ("__init__.py", "import warnings\nwarnings.simplefilter('ignore')", "warnings.filters"),
    ("__init__.py", "import os\nos.environ['XLA_FLAGS'] = ''", "environment"),
    ("__init__.py", "import matplotlib", "import of matplotlib"),
    ("report/table.py", "import matplotlib\nmatplotlib.use('agg')", "matplotlib.backend"),
    ("report/table.py", "plt.rcParams['lines.linewidth'] = 9", "matplotlib.rcParams"),
]


def test_importing_the_clean_package_changes_nothing(tmp_path):
    build(tmp_path, {}, IMPORTABLE)
    assert changes_on_import(tmp_path, "house") == []


@pytest.mark.parametrize(("file", "text", "word"), IMPORT_PLANTS, ids=[plant[2] for plant in IMPORT_PLANTS])
def test_a_change_on_import_is_reported(file, text, word, tmp_path):
    build(tmp_path, {file: text}, IMPORTABLE)
    assert word in changes_on_import(tmp_path, "house")


def test_an_array_made_on_import_is_reported(tmp_path):
    build(tmp_path, {"data/record.py": "import jax.numpy as jnp\n\nONE = jnp.ones(3)\n"}, IMPORTABLE)
    with pytest.raises(AssertionError, match="none_such"):
        changes_on_import(tmp_path, "house")
