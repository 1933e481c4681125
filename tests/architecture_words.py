"""The rules on language and long lines: the source text is read, with the standard library alone.

`python tests/architecture_words.py [path ...]` prints the breaches of each file as
`path:line: words [rule]`, their number in each file, and the density of the counted words. A path
is a folder, a `.py` or an `.md` file.
"""

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

LONGEST_LINE = 100

# Parts of names (snake_case or CamelCase): a name is a noun of the field, or a function's verb.
BANNED_IN_NAMES = {
    "participle in place of a noun": "tried told asked seen found spoiled begun",
    "adverb": "beside anew quickly",
    "metaphor": "kin way ways doubt doubts guilty hats bench twin twins",
    "quantity without a noun": "whole several",
}

# Patterns in docstrings and comments, without the code in backticks, and in documents. Case does
# not matter; a dot in the middle is white space, START the start of a sentence.
BANNED_IN_PROSE = {
    "verb of speech": r"says? said saying tells? told telling asks? asked asking",
    "not plain English": (
        r"anew likewise borne beside led·astray gone·on·with begun·again does·without"
    ),
    "metaphor": r"hats twins? kin guilty doubts",
    "noun clause in place of a noun": r"what·(?:is|was|are|were|it|they|the|a|an|no|one)",
    "needs a sentence of its own": r"of·which so·many as·it·(?:is|was)",
    "pronoun without a noun": r"START(?:that|those)·of",
}

# In 10,000 words of prose fewer than this number of each.
COUNTED = {
    "what": (r"what", 10.0),
    "speech": (r"says?|said|tells?|told|asks?|asked", 1.0),
}

Finding = tuple[int, str]
NAME_REASON = {word: reason for reason, words in BANNED_IN_NAMES.items() for word in words.split()}
START = r"""(?:\A|[.!?]\s+|\n\s*\n)[\s"'(]*\b"""
PROSE_PATTERNS = [
    (reason, rf"\b{pattern}\b".replace("·", r"\s+").replace(r"\bSTART", START))
    for reason, patterns in BANNED_IN_PROSE.items()
    for pattern in patterns.split()
]
WORD = re.compile(r"[A-Za-z]+(?:['-][A-Za-z]+)*")
CODE = re.compile(
    r"``[^`]+``|`[^`]*`|https?://\S+|\]\([^)]*\)|^\s*(?:>>>|\.\.\.) .*$", re.MULTILINE
)
FENCE = re.compile(r"^( *)(```|~~~).*?^ *\2 *$|<!--.*?-->", re.MULTILINE | re.DOTALL)
PRAGMA = re.compile(r"#\s*(?:noqa|type:|pyright:|fmt:|ruff:|!)")
NUMBERS = re.compile(r"""(?:[\s()\[\]{},;:|"'*/+-]|nan|inf|[0-9][0-9_.]*(?:[eE][+-]?[0-9]+)?)*""")
URL = re.compile(r"https?://\S+")
NO_WORD = " .!?\n\"'("


class Passage(NamedTuple):
    """Connected prose and the line on which it starts; code in it is masked by `~`."""

    line: int
    text: str


def banned_names(tree: ast.AST, path: str) -> Iterator[Finding]:
    """Names that the file defines, and its own, with a banned part."""
    own = (1, Path(path).stem) if Path(path).stem != "__init__" else (1, Path(path).parent.name)
    for line, name in sorted({own, *_defined(tree)}):
        for part in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name):
            if part.lower() in NAME_REASON:
                yield line, f"name {name}: '{part.lower()}', {NAME_REASON[part.lower()]}"


def banned_prose(passages: Iterable[Passage]) -> Iterator[Finding]:
    """Banned words and phrases, each with its reason."""
    for passage in passages:
        for reason, pattern in PROSE_PATTERNS:
            for match in re.finditer(pattern, passage.text, re.IGNORECASE):
                words = match[0].lstrip(NO_WORD)
                start = match.end() - len(words)
                line = passage.line + passage.text.count("\n", 0, start)
                yield line, f"'{' '.join(words.split())}': {reason}"


def long_lines(text: str) -> Iterator[Finding]:
    """Lines over the limit. Rows of numbers are exempt, and addresses do not count."""
    for line, row in enumerate(text.splitlines(), start=1):
        if len(URL.sub("", row)) > LONGEST_LINE and not NUMBERS.fullmatch(row):
            yield line, f"the line has {len(row)} characters; the limit is {LONGEST_LINE}"


class Density(NamedTuple):
    """Number of words of prose, and of each of the counted ones."""

    words: int
    counts: dict[str, int]

    def per_ten_thousand(self, name: str) -> float:
        return 1e4 * self.counts[name] / max(self.words, 1)


def density(passages: Iterable[Passage]) -> Density:
    """Count the words of the prose, code left out."""
    prose = "\n".join(passage.text for passage in passages)
    counts = {
        name: len(re.findall(rf"\b(?:{words})\b", prose, re.IGNORECASE))
        for name, (words, _) in COUNTED.items()
    }
    return Density(len(WORD.findall(prose)), counts)


def too_dense(passages: Iterable[Passage]) -> dict[str, str]:
    """The counted words that are too frequent, each with one sentence."""
    measured = density(passages)
    return {
        name: f"{name}: {measured.counts[name]} in {measured.words} words,"
        f" {measured.per_ten_thousand(name):.1f} in 10,000; under {limit:g}"
        for name, (_, limit) in COUNTED.items()
        if measured.counts[name] and measured.per_ten_thousand(name) >= limit
    }


def prose_of_python(text: str, tree: ast.AST) -> list[Passage]:
    """Docstrings (all strings that are statements) and comments; a block is one passage."""
    rows = text.splitlines()
    passages = []
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            lines = "\n".join(rows[node.lineno - 1 : node.end_lineno])
            passages.append(
                Passage(node.lineno, re.sub(r"^\s*[rRuU]?(?=[\"'])|\"\"\"|'''", " ", lines))
            )
    last, column = 0, -1
    for token in tokenize.generate_tokens(io.StringIO(text).readline) if "#" in text else ():
        if token.type != tokenize.COMMENT or PRAGMA.match(token.string):
            continue
        (line, start), comment = token.start, " " + token.string.lstrip("#")
        alone = token.line.lstrip().startswith("#")
        if alone and (last, column) == (line - 1, start):
            passages[-1] = Passage(passages[-1].line, f"{passages[-1].text}\n{comment}")
        else:
            passages.append(Passage(line, comment))
        last, column = line, start if alone else -1
    return [Passage(line, CODE.sub(_mask, prose)) for line, prose in passages]


def prose_of_markdown(text: str) -> list[Passage]:
    """The text outside of code blocks."""
    return [Passage(1, CODE.sub(_mask, FENCE.sub(_mask, text)))]


def _mask(match: re.Match[str]) -> str:
    return re.sub(r"\S", "~", match[0])


def _defined(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, name) of functions, classes, arguments, aliases, and variables and attributes set."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.alias) and node.asname:
            yield node.lineno, node.asname
        elif isinstance(node, ast.ExceptHandler | ast.MatchAs | ast.MatchStar) and node.name:
            yield node.lineno, node.name


def check(file: Path) -> tuple[list[str], list[Passage]]:
    """The breaches in one file as `path:line: words [rule]`, and its prose."""
    text = file.read_text(encoding="utf-8")
    findings: list[tuple[int, str, str]] = []
    passages: list[Passage] = []
    if file.suffix == ".py":
        findings += [(line, words, "lines") for line, words in long_lines(text)]
        tree = ast.parse(text, filename=str(file))
        names = banned_names(tree, str(file.resolve()))
        findings += [(line, words, "names") for line, words in names]
        passages = prose_of_python(text, tree)
    else:
        passages = prose_of_markdown(text)
    findings += [(line, words, "prose") for line, words in banned_prose(passages)]
    return [f"{file}:{line}: {words} [{rule}]" for line, words, rule in sorted(findings)], passages


def report(paths: list[str]) -> list[str]:
    """The lines of the command: all breaches, their number in each file, the densities."""
    prose: dict[str, list[Passage]] = {".py": [], ".md": []}
    counts: dict[Path, Counter[str]] = {}
    lines: list[str] = []
    for file in _files(paths):
        breaches, passages = check(file)
        lines += breaches
        prose[file.suffix] += passages
        counts[file] = Counter(text.rsplit("[", 1)[1].rstrip("]") for text in breaches)
    lines += ["", "Breaches in each file"]
    lines += [_row(count, str(file)) for file, count in counts.items() if count]
    lines += [_row(sum(counts.values(), Counter()), f"in all {len(counts)} files")]
    lines += ["", "Density in 10,000 words"]
    for label, suffix in (("comments and docstrings", ".py"), ("documents", ".md")):
        measured = density(prose[suffix])
        numbers = [
            f"{name} {measured.per_ten_thousand(name):.1f} ({number}; under {COUNTED[name][1]:g})"
            for name, number in measured.counts.items()
        ]
        lines += [f"  {label}: {', '.join(numbers)}, {measured.words} words"]
    return lines


def main(paths: list[str]) -> None:
    """Print the report on the paths, by default on `jaxid`."""
    sys.stdout.write("\n".join([*report(paths or ["jaxid"]), ""]))


def _row(count: Counter[str], label: str) -> str:
    parts = ", ".join(f"{count[rule]} {rule}" for rule in sorted(count))
    return f"{count.total():6d}  {label}  ({parts})"


def _files(paths: list[str]) -> Iterator[Path]:
    """Each file; hidden files in folders are left out."""
    for path in map(Path, paths):
        if not path.is_dir():
            yield path
            continue
        for file in sorted((*path.rglob("*.py"), *path.rglob("*.md"))):
            if not any(part.startswith(".") for part in file.relative_to(path).parts):
                yield file


if __name__ == "__main__":
    main(sys.argv[1:])
