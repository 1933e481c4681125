"""The rules of the house, read from the source text alone: nothing of the checked package is imported.

`breaches(folder)` lists every breach as `path:line: words [rule]`. A rule is a function from one `Source` to pairs of
line and words; the tables say who may use what, and `test_architecture.py` plants a breach of each rule.
"""

import ast
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

FLOORS = (
    {"_foundation"},
    {"data"},
    {"models"},
    {"simulation"},
    {"sensitivity"},
    {"estimation"},
    {"structure"},
    {"diagnosis", "design"},  # siblings: neither imports the other
    {"study"},
    {"report"},
)
LEVEL = {name: level for level, names in enumerate(FLOORS) for name in names}
DOMAINS = {  # what stands beside the floors, and the floors that it stands on
    "aircraft": {"_foundation", "data", "models", "simulation", "aircraft"},
    "measured": {"_foundation", "data", "models", "simulation", "estimation", "measured"},
}
ENTRY = "__main__.py"

HOMES = {
    "diffrax": ("simulation/*",),
    "lineax": ("estimation/*",),
    "optimistix": ("_foundation/results.py", "simulation/*", "estimation/*", "diagnosis/process_noise.py", "design/*"),
    "interpax": (
        "models/tables.py",
        "models/effects_sensor.py",
        "simulation/inputs.py",
        "aircraft/kinematics_corrected.py",
    ),
    "matplotlib": ("report/*",),
    "jinja2": ("report/*",),
}
SOLVERS = {"diffrax", "optimistix", "lineax"}
PUBLIC_ONLY = {"diffrax", "equinox", "jax", "jaxlib", "lineax", "optimistix"}

MEMORY = "_foundation/memory.py"  # asks the system of this process; no user's file
FILE_HOMES = ("data/io*", "data/datasets*", "report/*", ENTRY, MEMORY)
FILE_METHODS = {
    *("open", "read_text", "write_text", "read_bytes", "write_bytes", "mkdir", "touch", "unlink", "rmdir", "savefig"),
    *("to_csv", "to_excel", "to_hdf", "to_netcdf", "to_parquet", "to_pickle", "to_zarr"),
}
FILE_FUNCTIONS = (
    *(
        "open",
        "io.open",
        "shutil.copy*",
        "shutil.move",
        "shutil.rmtree",
        "tempfile.*",
        "os.makedirs",
        "os.mkdir",
        "os.remove",
        "os.rename",
        "os.unlink",
    ),
    *("numpy.load", "numpy.loadtxt", "numpy.genfromtxt", "numpy.fromfile", "numpy.save*", "scipy.io*", "pandas.read_*"),
    *("xarray.open_*", "xarray.load_*", "jax.numpy.load", "jax.numpy.save*", "equinox.tree_*serialise_leaves"),
)
OWN_RANDOM_STATE = {"default_rng", "Generator", "SeedSequence", "BitGenerator", "PCG64"}

LONGEST_FUNCTION, LONGEST_FILE = 80, 400

Finding = tuple[int, str]


class Imported(NamedTuple):
    """One imported name: in `from a.b import c as d` the path is a.b.c, the stem a.b, and `d` means the path."""

    line: int
    path: tuple[str, ...]
    stem: tuple[str, ...]
    alias: str
    means: tuple[str, ...]
    relative: bool


class Source:
    """One file of the package: its place in the house, its syntax tree, and what its names stand for."""

    def __init__(self, root: Path, file: Path):
        self.package = root.name
        self.place = file.relative_to(root).as_posix()
        self.floor = self.place.split("/")[0].removesuffix(".py")
        self.text = file.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text, filename=str(file))
        self.imports = list(self._imports())
        self.meaning = {found.alias: found.means for found in self.imports}
        self.references = list(self._references(self.tree))

    def ours(self) -> Iterator[tuple[int, str]]:
        """(line, floor) of every import of this package from inside it; imports of the bare root are left to `root`."""
        for found in self.imports:
            if found.path[0] == self.package and len(found.path) > 1:
                yield found.line, found.path[1]

    def theirs(self) -> Iterator[Imported]:
        return (found for found in self.imports if found.path[0] != self.package)

    def lives_in(self, homes: tuple[str, ...]) -> bool:
        return any(fnmatch(self.place, home) for home in homes)

    def _imports(self) -> Iterator[Imported]:
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                for name in node.names:
                    path = tuple(name.name.split("."))
                    means = path if name.asname else path[:1]
                    yield Imported(node.lineno, path, path, name.asname or path[0], means, False)
            elif isinstance(node, ast.ImportFrom):
                stem = self._stem(node)
                for name in node.names:
                    path = (*stem, name.name)
                    yield Imported(node.lineno, path, stem, name.asname or name.name, path, node.level > 0)

    def _stem(self, node: ast.ImportFrom) -> tuple[str, ...]:
        here = (self.package, *self.place.split("/")[:-1])
        base = here[: max(len(here) - node.level + 1, 1)] if node.level else ()
        return (*base, *(node.module.split(".") if node.module else ()))

    def _references(self, tree: ast.AST) -> Iterator[tuple[int, str]]:
        """(line, dotted name) of every name, aliases replaced by what they mean; `name =` where it is assigned to."""
        inner = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Name | ast.Attribute) and id(node) not in inner:
                dotted = self._dotted(node)
                if dotted:
                    yield node.lineno, dotted if isinstance(node.ctx, ast.Load) else f"{dotted} ="

    def _dotted(self, node: ast.expr) -> str | None:
        if isinstance(node, ast.Attribute):
            stem = self._dotted(node.value)
            return f"{stem}.{node.attr}" if stem else None
        return ".".join(self.meaning.get(node.id, (node.id,))) if isinstance(node, ast.Name) else None


def floors(source: Source) -> Iterator[Finding]:
    """Imports point down the map; the domains stand on the lowest floors."""
    own = source.floor
    if own in ("__init__", "__main__"):
        return
    if own not in LEVEL and own not in DOMAINS:
        yield 1, f"{own} is on no floor of the map"
        return
    for line, target in source.ours():
        if own in DOMAINS:
            if target not in DOMAINS[own]:
                yield line, f"{own} imports {target}, which is not among the floors it stands on"
        elif target in LEVEL and target != own and LEVEL[target] >= LEVEL[own]:
            yield line, f"{own} imports {target}, which is not below it"


def core_without_domain(source: Source) -> Iterator[Finding]:
    """The core serves every domain and names none."""
    if source.floor not in (*DOMAINS, "__main__"):
        for line, target in source.ours():
            if target in DOMAINS:
                yield line, f"the core imports {target}"


def nothing_imports_report(source: Source) -> Iterator[Finding]:
    """Plots and tables come last, so that no computation needs them."""
    if source.floor not in ("report", "__main__"):
        for line, target in source.ours():
            if target == "report":
                yield line, "only __main__ imports report"


def root(source: Source) -> Iterator[Finding]:
    """A module that imports its own package root goes in circles; inside, imports are relative."""
    for found in source.imports:
        if found.path[0] != source.package or (source.place == "__init__.py" and found.relative):
            continue
        if not found.relative:
            yield found.line, f"absolute import of {source.package}; inside the package imports are relative"
        elif len(found.stem) == 1:
            yield found.line, "imports the package root; name the floor: `from ..floor import name`"


def homes(source: Source) -> Iterator[Finding]:
    """Each of these libraries is used in one place."""
    for found in source.theirs():
        allowed = HOMES.get(found.path[0])
        if allowed and not source.lives_in(allowed):
            yield found.line, f"{found.path[0]} is imported only in {', '.join(allowed)}"


def equations_without_solvers(source: Source) -> Iterator[Finding]:
    """Equations do not know how they are solved."""
    if source.floor in ("models", *DOMAINS):
        for found in source.theirs():
            if found.path[0] in SOLVERS:
                yield found.line, f"equations never import {found.path[0]}"


def public_interfaces(source: Source) -> Iterator[Finding]:
    """Underscore modules and `equinox.internal` change without notice."""
    for line, dotted in _used(source):
        first, *rest = dotted.split(".")
        hidden = any(part.startswith("_") and not part.startswith("__") for part in rest)
        if first in PUBLIC_ONLY and (hidden or dotted.startswith("equinox.internal")):
            yield line, f"{dotted} is not a public interface"


def no_config(source: Source) -> Iterator[Finding]:
    """Settings belong to the user; the check for float64 may read its one."""
    if source.place == ENTRY:
        return
    for line, dotted in _used(source):
        reads_x64 = source.place == "_foundation/checks.py" and dotted == "jax.config.jax_enable_x64"
        touches = dotted == "jax.config" or dotted.startswith(
            ("jax.config.", "jax.enable_x64", "jax.experimental.enable_")
        )
        if touches and not reads_x64:
            yield line, f"{dotted}: library code leaves JAX's settings alone"


def no_print(source: Source) -> Iterator[Finding]:
    """Objects print themselves when the user asks."""
    if source.place != ENTRY:
        for line, dotted in source.references:
            if dotted in ("print", "jax.debug.print", "sys.stdout.write"):
                yield line, f"{dotted}: library code does not print"


def no_global_random_state(source: Source) -> Iterator[Finding]:
    """Draws come from a key or a generator that the caller gives."""
    imports_random = any(found.path[0] == "random" for found in source.theirs())
    for line, dotted in _used(source):
        parts = dotted.split(".")
        legacy = parts[:2] == ["numpy", "random"] and len(parts) > 2 and parts[2] not in OWN_RANDOM_STATE
        if legacy or (imports_random and parts[0] == "random"):
            yield line, f"{dotted} is global random state; take a key or a generator"


def no_files(source: Source) -> Iterator[Finding]:
    """Files are read and written at the border only."""
    if source.lives_in(FILE_HOMES):
        return
    words = f"files are touched only in {', '.join(FILE_HOMES)}"
    for line, dotted in _used(source):
        if any(fnmatch(dotted, name) for name in FILE_FUNCTIONS):
            yield line, f"{dotted}: {words}"
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in FILE_METHODS:
            yield node.func.end_lineno or node.lineno, f".{node.func.attr}(): {words}"


def face_without_code(source: Source) -> Iterator[Finding]:
    """`__init__.py` of the package re-exports the public names and does nothing else."""
    if source.place == "__init__.py":
        for node in source.tree.body:
            if not (isinstance(node, ast.Import | ast.ImportFrom) or _is_docstring(node) or _is_all(node)):
                yield node.lineno, "the package's __init__ holds only its docstring, imports and __all__"


def short_functions(source: Source) -> Iterator[Finding]:
    """A body that does not fit on a page holds more than one thought."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if _is_docstring(node.body[0]) else node.body
            lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
            if lines > LONGEST_FUNCTION:
                yield node.lineno, f"the body of {node.name} has {lines} lines; the limit is {LONGEST_FUNCTION}"


def short_files(source: Source) -> Iterator[Finding]:
    """One concept per file."""
    lines = len(source.text.splitlines())
    if lines > LONGEST_FILE:
        yield lines, f"the file has {lines} lines; the limit is {LONGEST_FILE}"


RULES: tuple[Callable[[Source], Iterator[Finding]], ...] = (
    *(floors, core_without_domain, nothing_imports_report, root, homes, equations_without_solvers, public_interfaces),
    *(no_config, no_print, no_global_random_state, no_files, face_without_code, short_functions, short_files),
)


def breaches(package: Path) -> list[str]:
    """Every breach of every rule in the package's folder, as `place:line: words [rule]`."""
    sources = [Source(package, file) for file in sorted(package.rglob("*.py"))]
    return [
        f"{package.name}/{source.place}:{line}: {words} [{rule.__name__}]"
        for source in sources
        for rule in RULES
        for line, words in rule(source)
    ]


def _used(source: Source) -> list[Finding]:
    """(line, dotted name) of everything imported from elsewhere or named in the code, each once, in order."""
    return sorted({(found.line, ".".join(found.path)) for found in source.theirs()} | set(source.references))


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _is_all(node: ast.stmt) -> bool:
    return isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["__all__"]
