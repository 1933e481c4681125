"""The rules of the house, read from the source text: nothing of the package is imported.

`breaches(folder)` lists every breach as `path:line: words [rule]`. A rule of `RULES` is a function
from one `Source` to pairs of line and words; one of `HOUSE_RULES` compares all sources and adds the
source to each pair. The tables list the permissions, and `test_architecture.py` plants a breach of
each rule. The words of names and prose, and the length of lines, stand in `architecture_words.py`.

`python tests/architecture.py [path ...]` prints the breaches of these last rules in a folder, a
`.py` or an `.md` file: see `architecture_words.py`.
"""

import ast
import itertools
import sys
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

import architecture_words

FLOORS = (
    {"_foundation"},
    {"data"},
    {"models"},
    {"effects"},
    {"simulation"},
    {"sensitivity"},
    {"estimation"},
    {"uncertainty"},
    {"structure"},
    {"diagnosis", "design"},  # siblings: neither imports the other
    {"batches"},
    {"loop"},
    {"study"},
    {"report"},
)
LEVEL = {name: level for level, names in enumerate(FLOORS) for name in names}
DOMAINS = {  # not among the floors; each stands on these floors
    "aircraft": {"_foundation", "data", "models", "effects", "simulation", "aircraft"},
    "measured": {
        *("_foundation", "data", "models", "effects", "simulation", "estimation", "measured"),
    },
}
DISTRICTS = {  # of a domain, from the lowest to the highest
    "aircraft": (
        *("physics", "air", "instruments", "records", "vehicle", "airframes", "reconstruction"),
        *("effects", "flight", "identification"),
    ),
}
ENTRY = "__main__.py"
CONFIGURATION = "_foundation/configuration.py"  # `configure`, which the user calls

HOMES = {
    "diffrax": ("simulation/*",),
    "lineax": ("estimation/*",),
    "optimistix": (
        "_foundation/results.py",
        "simulation/*",
        "estimation/*",
        "design/*",
    ),
    "interpax": (
        "models/tables.py",
        "effects/sensor.py",
        "simulation/*",
        "aircraft/reconstruction/*",
    ),
    "matplotlib": ("report/*",),
    "jinja2": ("report/*",),
}
SOLVERS = {"diffrax", "optimistix", "lineax"}
PUBLIC_ONLY = {"diffrax", "equinox", "jax", "jaxlib", "lineax", "optimistix"}

MEMORY = "_foundation/memory.py"  # reads the memory of this process; no user's file
# Results of a batch and of studies, in a folder that the user names, and the locks of that folder.
STORES = ("batches/store.py", "batches/locks.py", "study/many/study_folder.py")
# Exported programs, next to the compiled ones that JAX stores, once `configure` is called.
EXPORTED = "_foundation/stored_programs.py"
FILE_HOMES = (
    *("data/io*", "data/datasets*", "report/*", ENTRY, MEMORY, CONFIGURATION, EXPORTED),
    *STORES,
)
FILE_METHODS = {
    *(
        "open",
        "read_text",
        "write_text",
        "read_bytes",
        "write_bytes",
        "mkdir",
        "touch",
        "unlink",
        "rmdir",
        "savefig",
    ),
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
    *(
        "numpy.load",
        "numpy.loadtxt",
        "numpy.genfromtxt",
        "numpy.fromfile",
        "numpy.save*",
        "scipy.io*",
        "pandas.read_*",
    ),
    *(
        "xarray.open_*",
        "xarray.load_*",
        "jax.numpy.load",
        "jax.numpy.save*",
        "equinox.tree_*serialise_leaves",
    ),
)
OWN_RANDOM_STATE = {"default_rng", "Generator", "SeedSequence", "BitGenerator", "PCG64"}

LONGEST_FUNCTION, LONGEST_FILE = 80, 400
MOST_MODULES = 20  # in one folder, `__init__.py` left out
MOST_COMPLEX, COMPLEX, COMPLEX_BLOCKS = 20, 10, 10  # as many blocks may be above COMPLEX

Finding = tuple[int, str]
HouseFinding = tuple["Source", int, str]


class Imported(NamedTuple):
    """One imported name.

    In `from a.b import c as d` the path is a.b.c, the stem a.b, and `d` means the path.
    """

    line: int
    path: tuple[str, ...]
    stem: tuple[str, ...]
    alias: str
    means: tuple[str, ...]
    relative: bool


class Source:
    """One file of the package: its place, its syntax tree, and the meaning of its names."""

    def __init__(self, root: Path, file: Path):
        self.package = root.name
        self.place = file.relative_to(root).as_posix()
        self.floor = self.place.split("/")[0].removesuffix(".py")
        self.text = file.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text, filename=str(file))
        self.imports = [imported for imported in self._imports() if not self._draws(imported)]
        self.meaning = {imported.alias: imported.means for imported in self.imports}
        self.references = list(self._references(self.tree))

    def ours(self) -> Iterator[tuple[int, str]]:
        """(line, floor) of every import of the package inside it, but for its bare root."""
        for imported in self.imports:
            if imported.path[0] == self.package and len(imported.path) > 1:
                yield imported.line, imported.path[1]

    def theirs(self) -> Iterator[Imported]:
        return (imported for imported in self.imports if imported.path[0] != self.package)

    def prose(self) -> list[architecture_words.Passage]:
        return architecture_words.prose_of_python(self.text, self.tree)

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
                    yield Imported(
                        node.lineno, path, stem, name.asname or name.name, path, node.level > 0
                    )

    def _draws(self, imported: Imported) -> bool:
        """True for an import of `report` in a method `plot`, which runs when it is called.

        Objects have plots so that a notebook draws them in one line. Nothing is computed from
        them, and importing the package does not import matplotlib.
        """
        return imported.path[:2] == (self.package, "report") and any(
            method.lineno <= imported.line <= (method.end_lineno or 0)
            for node in ast.walk(self.tree)
            if isinstance(node, ast.ClassDef)
            for method in node.body
            if isinstance(method, ast.FunctionDef) and method.name == "plot"
        )

    def _stem(self, node: ast.ImportFrom) -> tuple[str, ...]:
        here = (self.package, *self.place.split("/")[:-1])
        base = here[: max(len(here) - node.level + 1, 1)] if node.level else ()
        return (*base, *(node.module.split(".") if node.module else ()))

    def _references(self, tree: ast.AST) -> Iterator[tuple[int, str]]:
        """(line, dotted name) of every name, aliases resolved; `name =` where it is assigned to."""
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
        return (
            ".".join(self.meaning.get(node.id, (node.id,))) if isinstance(node, ast.Name) else None
        )


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


def districts(source: Source) -> Iterator[Finding]:
    """Inside a domain, imports point down the list of its districts; each file stands in one."""
    order = DISTRICTS.get(source.floor)
    if not order or source.place == f"{source.floor}/__init__.py":
        return
    own = source.place.split("/")[1]
    if own not in order:
        yield 1, f"{source.place} is in no district of {source.floor}"
        return
    targets = {
        (imported.line, imported.path[2] if len(imported.path) > 2 else source.floor)
        for imported in source.imports
        if imported.path[:2] == (source.package, source.floor)
    }
    for line, target in sorted(targets):
        if target not in order:
            yield line, f"{target} is no district of {source.floor}"
        elif order.index(target) > order.index(own):
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
                yield line, "only __main__ and methods `plot` import report"


def root(source: Source) -> Iterator[Finding]:
    """A module that imports its own package root goes in circles; inside, imports are relative."""
    for imported in source.imports:
        if imported.path[0] != source.package or (
            source.place == "__init__.py" and imported.relative
        ):
            continue
        if not imported.relative:
            yield (
                imported.line,
                f"absolute import of {source.package}; inside the package imports are relative",
            )
        elif len(imported.stem) == 1:
            yield (
                imported.line,
                "imports the package root; name the floor: `from ..floor import name`",
            )


def homes(source: Source) -> Iterator[Finding]:
    """Each of these libraries is used in one place."""
    for imported in source.theirs():
        allowed = HOMES.get(imported.path[0])
        if allowed and not source.lives_in(allowed):
            yield imported.line, f"{imported.path[0]} is imported only in {', '.join(allowed)}"


def equations_without_solvers(source: Source) -> Iterator[Finding]:
    """Equations do not know how they are solved."""
    if source.floor in ("models", "effects", *DOMAINS):
        for imported in source.theirs():
            if imported.path[0] in SOLVERS:
                yield imported.line, f"equations never import {imported.path[0]}"


def public_interfaces(source: Source) -> Iterator[Finding]:
    """Underscore modules and `equinox.internal` change without notice."""
    for line, dotted in _used(source):
        first, *rest = dotted.split(".")
        hidden = any(part.startswith("_") and not part.startswith("__") for part in rest)
        if first in PUBLIC_ONLY and (hidden or dotted.startswith("equinox.internal")):
            yield line, f"{dotted} is not a public interface"


def no_config(source: Source) -> Iterator[Finding]:
    """Settings belong to the user: one file changes them, and the check for float64 reads one."""
    if source.place == CONFIGURATION:
        return
    for line, dotted in _used(source):
        reads_x64 = (
            source.place == "_foundation/checks.py" and dotted == "jax.config.jax_enable_x64"
        )
        touches = dotted == "jax.config" or dotted.startswith(
            (
                *("jax.config.", "jax.enable_x64", "jax.experimental.enable_"),
                "jax.experimental.compilation_cache",
            )
        )
        if touches and not reads_x64:
            yield line, f"{dotted}: library code leaves JAX's settings alone"


def no_print(source: Source) -> Iterator[Finding]:
    """Objects print themselves when the user requests it."""
    if source.place != ENTRY:
        for line, dotted in source.references:
            if dotted in ("print", "jax.debug.print", "sys.stdout.write"):
                yield line, f"{dotted}: library code does not print"


def no_global_random_state(source: Source) -> Iterator[Finding]:
    """Draws come from a key or a generator that the caller gives."""
    imports_random = any(imported.path[0] == "random" for imported in source.theirs())
    for line, dotted in _used(source):
        parts = dotted.split(".")
        legacy = (
            parts[:2] == ["numpy", "random"] and len(parts) > 2 and parts[2] not in OWN_RANDOM_STATE
        )
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
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in FILE_METHODS
        ):
            yield node.func.end_lineno or node.lineno, f".{node.func.attr}(): {words}"


def face_without_code(source: Source) -> Iterator[Finding]:
    """`__init__.py` of the package re-exports the public names and does nothing else."""
    if source.place == "__init__.py":
        for node in source.tree.body:
            if not (
                isinstance(node, ast.Import | ast.ImportFrom)
                or _is_docstring(node)
                or _is_all(node)
            ):
                yield (
                    node.lineno,
                    "the package's __init__ holds only its docstring, imports and __all__",
                )


def short_functions(source: Source) -> Iterator[Finding]:
    """A body that does not fit on a page holds more than one thought."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if _is_docstring(node.body[0]) else node.body
            lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
            if lines > LONGEST_FUNCTION:
                yield (
                    node.lineno,
                    f"the body of {node.name} has {lines} lines; the limit is {LONGEST_FUNCTION}",
                )


def short_files(source: Source) -> Iterator[Finding]:
    """One concept per file."""
    lines = len(source.text.splitlines())
    if lines > LONGEST_FILE:
        yield lines, f"the file has {lines} lines; the limit is {LONGEST_FILE}"


def banned_words(source: Source) -> Iterator[Finding]:
    """Names, docstrings and comments are plain technical English."""
    path = f"{source.package}/{source.place}"
    yield from architecture_words.banned_names(source.tree, path)
    yield from architecture_words.banned_prose(source.prose())


def long_lines(source: Source) -> Iterator[Finding]:
    """Two files fit side by side on a screen."""
    return architecture_words.long_lines(source.text)


def file_cycles(sources: list[Source]) -> Iterator[HouseFinding]:
    """Files that need each other are one file in two; imports for type checking count."""
    graph = _file_graph(sources)
    reach = {place: _reachable(graph, place) for place in graph}
    for source in sources:
        ring = {place for place in reach[source.place] if source.place in reach[place]}
        for target, line in graph[source.place].items():
            if target in ring:
                back = " -> ".join(_shortest_path(graph, target, source.place))
                yield source, line, f"cycle of files: {source.place} -> {back}"


def crowded_folders(sources: list[Source]) -> Iterator[HouseFinding]:
    """A folder is read at a glance; files that part 8 of the project replaces do not count."""
    modules = [source for source in sources if not source.place.endswith("__init__.py")]
    for folder, group in itertools.groupby(sorted(modules, key=_folder), key=_folder):
        members = list(group)
        if len(members) > MOST_MODULES:
            words = f"the folder {folder or '.'} has {len(members)} modules"
            yield members[-1], 1, f"{words}; the limit is {MOST_MODULES}"


def one_value_per_constant(sources: list[Source]) -> Iterator[HouseFinding]:
    """A constant of one name has one value; the second place with another is reported."""
    first: dict[str, tuple[Source, int, str]] = {}
    for source in sources:
        for line, name, value in _constants(source.tree):
            other, other_line, other_value = first.setdefault(name, (source, line, value))
            if other is not source and other_value != value:
                there = f"{_short(other_value)} in {other.place}:{other_line}"
                yield source, line, f"{name} is {_short(value)} here and {there}"


def complexity(sources: list[Source]) -> Iterator[HouseFinding]:
    """Cyclomatic complexity (McCabe 1976, counted by radon) of functions, methods and classes."""
    from radon.complexity import cc_visit_ast

    blocks = [
        (source, block.lineno, block.fullname, block.complexity)
        for source in sources
        for block in cc_visit_ast(source.tree)
        if block.complexity > COMPLEX
    ]
    for source, line, name, number in blocks:
        if number > MOST_COMPLEX:
            words = f"the complexity of {name} is {number}"
            yield source, line, f"{words}; the limit is {MOST_COMPLEX}"
        elif len(blocks) > COMPLEX_BLOCKS:
            words = (
                f"{name} ({number}) is one of {len(blocks)} blocks of complexity above {COMPLEX}"
            )
            yield source, line, f"{words}; the limit is {COMPLEX_BLOCKS} blocks"


def dense_words(sources: list[Source]) -> Iterator[HouseFinding]:
    """The counted words are rare in the comments and docstrings of the package."""
    passages = [(source, passage) for source in sources for passage in source.prose()]
    dense = architecture_words.too_dense([passage for _, passage in passages])
    for name, words in dense.items():
        for source, passage in passages:
            if architecture_words.density([passage]).counts[name]:
                yield source, passage.line, f"first of all comments and docstrings: {words}"
                break


RULES: tuple[Callable[[Source], Iterator[Finding]], ...] = (
    *(floors, districts, core_without_domain, nothing_imports_report, root, homes),
    *(equations_without_solvers, public_interfaces, no_config, no_print, no_global_random_state),
    *(no_files, face_without_code, short_functions, short_files, banned_words, long_lines),
)
HOUSE_RULES: tuple[Callable[[list[Source]], Iterator[HouseFinding]], ...] = (
    *(file_cycles, crowded_folders, one_value_per_constant, complexity, dense_words),
)


def breaches(package: Path) -> list[str]:
    """Every breach of every rule in the package's folder, as `place:line: words [rule]`."""
    sources = [Source(package, file) for file in sorted(package.rglob("*.py"))]
    in_files = [
        (source, line, words, rule.__name__)
        for source in sources
        for rule in RULES
        for line, words in rule(source)
    ]
    between_files = [
        (source, line, words, rule.__name__)
        for rule in HOUSE_RULES
        for source, line, words in rule(sources)
    ]
    return [
        f"{package.name}/{source.place}:{line}: {words} [{name}]"
        for source, line, words, name in in_files + between_files
    ]


def _file_graph(sources: list[Source]) -> dict[str, dict[str, int]]:
    """The files that each file imports, with the line of the first import of each.

    The package's own `__init__.py` is no target: the rule `root` reports its imports.
    """
    places = {source.place for source in sources}
    graph: dict[str, dict[str, int]] = {source.place: {} for source in sources}
    for source in sources:
        for imported in source.imports:
            for path in (imported.path, imported.stem):
                name = "/".join(path[1:]) if path[0] == source.package else "-"
                files = {f"{name}.py", f"{name}/__init__.py"} & places
                if files:
                    graph[source.place].setdefault(files.pop(), imported.line)
                    break
    return graph


def _reachable(graph: dict[str, dict[str, int]], start: str) -> set[str]:
    """The files that the file needs, directly or through others; itself only in a cycle."""
    reached: set[str] = set()
    waiting = [*graph[start]]
    while waiting:
        place = waiting.pop()
        if place not in reached:
            reached.add(place)
            waiting += graph[place]
    return reached


def _shortest_path(graph: dict[str, dict[str, int]], start: str, end: str) -> list[str]:
    paths = [[start]]
    visited = {start}
    for path in paths:  # grows while it is read: breadth first
        if path[-1] == end:
            return path
        fresh = [place for place in graph[path[-1]] if place not in visited]
        visited.update(fresh)
        paths += [[*path, place] for place in fresh]
    raise ValueError(f"no path from {start} to {end}")


def _constants(tree: ast.Module) -> Iterator[tuple[int, str, str]]:
    """(line, name, value as source text) of the constants that the module assigns at its top."""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            pairs = [(node.target, node.value)]
        elif isinstance(node, ast.Assign):
            pairs = [pair for target in node.targets for pair in _matched(target, node.value)]
        else:
            continue
        for target, value in pairs:
            if isinstance(target, ast.Name) and target.id.isupper():
                yield node.lineno, target.id, ast.unparse(value)


def _matched(target: ast.expr, value: ast.expr) -> list[tuple[ast.expr, ast.expr]]:
    """`a, b = 1, 2` as two pairs; else one pair."""
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        return list(zip(target.elts, value.elts, strict=False))
    return [(target, value)]


def _folder(source: Source) -> str:
    return source.place.rpartition("/")[0]


def _short(value: str) -> str:
    return value if len(value) <= 40 else f"{value[:37]}..."


def _used(source: Source) -> list[Finding]:
    """(line, dotted name) of all that is imported from elsewhere or named, each once, in order."""
    return sorted(
        {(imported.line, ".".join(imported.path)) for imported in source.theirs()}
        | set(source.references)
    )


def _is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _is_all(node: ast.stmt) -> bool:
    return isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == [
        "__all__"
    ]


if __name__ == "__main__":
    architecture_words.main(sys.argv[1:])
