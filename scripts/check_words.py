"""Check the words of docs and source: ruled-out words, long sentences, class names twice, docstrings.

    python scripts/check_words.py             # every finding, and exit status 1 if there is one
    python scripts/check_words.py --count     # findings by room and rule, and words a sentence by page

Words are checked in docs, in docstrings, in comments and in every string of the source: help texts, errors,
log lines and status texts are strings. `code` in the docs is not words. Names of functions, classes,
arguments and variables are checked in the source and in the tests; of the tests nothing else is.
Sentences are checked in docs. A full stop and a colon end one, a semicolon does not; code blocks, tables and
headings have none. `ROOMS` names what is checked; `LEFT_OUT` names what is not, and why.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

TOP = Path(__file__).resolve().parents[1]

# Each rule: a name, the words it finds, and what to write in their place.
RULES = {
    "nameless-actor": (
        r"whoever|whomever|somebody|someone|nobody|no one|everybody|everyone|anybody|anyone",
        "name the actor: bridge, worker, operator, subscriber, robot programmer",
    ),
    "nameless-owner": (
        r"ours|theirs|one's|whom",
        "name the owner: this instance's, the service's, the sender's",
    ),
    "code-that-talks": (
        r"tell|tells|told|telling",
        "say what is published, stated, reported, returned or distinguished",
    ),
    "code-that-hears": (
        r"hear|hears|heard|hearing",
        "say what is received",
    ),
    "code-that-knows": (
        r"knows",
        "say what is stored, listed, declared or computed",
    ),
    "code-that-feels": (
        r"forgive|forgives|forgiven|shout|shouts|wants",
        "say what is reset, published, requested or required",
    ),
}
WORDS = {name: re.compile(rf"\b(?:{words})\b", re.IGNORECASE) for name, (words, _) in RULES.items()}
ADVICE = {name: advice for name, (_, advice) in RULES.items()} | {
    "long-sentence": "split it: one idea a sentence, at most 20 words",
    "class-twice": "rename the less central class: one name, one concept",
    "module-docstring": "open the module with a sentence that states what it holds",
    "docstring-opening": "open with a verb and its object, 'Return …', or with a noun phrase",
}
# No first words of a docstring: of a question, or of a clause that stands for a noun.
OPENINGS = re.compile(
    r"(?:What|How|Where|As|Who|When|Is|Are|Does|Has|Have|Which|Why|Was|Can|May|Do|Its|It|Of|Would|Will|Were"
    r"|Must|Did)\b"
)
MAX_SENTENCE_WORDS = 30
MIN_DOCSTRING_WORDS = 4

# What is checked: files and folders, from the top of the repository.
ROOMS = (
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "docs",
    "protocol",
    "service",
    "clients",
    "lab",
    "examples",
    "scripts",
)
NAMES_ONLY = ("tests",)  # where names are checked, and no text
# What is not checked, with the reason.
LEFT_OUT = {"scripts/check_words.py": "it lists the words"}
# Where a class name may occur once.
SOURCE = ("protocol/", "service/", "clients/", "lab/", "scripts/", "examples/", "deploy/")


class WordFinding(NamedTuple):
    """One offence. path: relative to the top; line: from 1."""

    path: str
    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.text} ({self.rule}: {ADVICE[self.rule]})"


def words_in(path: str, line: int, text: str) -> Iterator[WordFinding]:
    """Yield the ruled-out words of a text that begins at a line; `code` is skipped."""
    prose = re.sub(r"`[^`\n]*`", lambda code: " " * len(code.group()), text)
    for rule, pattern in WORDS.items():
        for match in pattern.finditer(prose):
            yield WordFinding(path, line + prose.count("\n", 0, match.start()), rule, repr(match.group()))


def in_markdown(path: str, text: str) -> Iterator[WordFinding]:
    """Yield the ruled-out words and the long sentences of a document."""
    text = _without_code(text)
    yield from words_in(path, 1, text)
    for line, sentence in _sentences(text):
        count = len(sentence.split())
        if count > MAX_SENTENCE_WORDS:
            start = " ".join(sentence.split()[:8])
            yield WordFinding(path, line, "long-sentence", f"{count} words: {start!r} …")


def in_source(path: str, text: str) -> Iterator[WordFinding]:
    """Yield the ruled-out words of comments and strings, and a missing docstring of the module."""
    tree = ast.parse(text)
    names = {id(item) for node in tree.body if _declares_names(node) for item in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in names:
            yield from words_in(path, node.lineno, node.value)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield from words_in(path, token.start[0], token.string)
    yield from docstring_openings(path, tree)
    if tree.body and not _is_sentence(ast.get_docstring(tree)):
        yield WordFinding(path, 1, "module-docstring", f"docstring {ast.get_docstring(tree)!r}"[:100])


def docstring_openings(path: str, tree: ast.Module) -> Iterator[WordFinding]:
    """Yield the docstrings of classes and functions that open as `OPENINGS` has it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstring = ast.get_docstring(node) or ""
            if OPENINGS.match(docstring):
                start = docstring.splitlines()[0][:60]
                yield WordFinding(path, node.lineno, "docstring-opening", f"docstring {start!r}")


def names_in(path: str, text: str) -> Iterator[WordFinding]:
    """Yield the names of a module with a ruled-out word in them, each where it is given."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                pass
            case (
                ast.Name(id=name, ctx=ast.Store())
                | ast.Attribute(attr=name, ctx=ast.Store())
                | ast.arg(arg=name)
            ):
                pass
            case _:
                continue
        words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|_", " ", name)
        for rule, pattern in WORDS.items():
            if pattern.search(words):
                yield WordFinding(path, node.lineno, rule, f"name {name}")


def classes_in(path: str, text: str) -> Iterator[tuple[str, str, int]]:
    """Yield (name, path, line) of each class of a module, nested ones too."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef):
            yield node.name, path, node.lineno


def twice(classes: Iterable[tuple[str, str, int]]) -> Iterator[WordFinding]:
    """Yield every class whose name another class has too."""
    places = defaultdict(list)
    for name, path, line in classes:
        places[name].append((path, line))
    for name, found in places.items():
        for path, line in found:
            others = ", ".join(f"{other}:{at}" for other, at in found if (other, at) != (path, line))
            if others:
                yield WordFinding(path, line, "class-twice", f"class {name} also in {others}")


def files(top: Path) -> Iterator[tuple[str, str]]:
    """Yield (relative path, text) of each file that is checked."""
    for room in (*ROOMS, *NAMES_ONLY):
        root = top / room
        for file in [root] if root.is_file() else sorted((*root.rglob("*.py"), *root.rglob("*.md"))):
            path = file.relative_to(top).as_posix()
            if not any(path.startswith(left_out) for left_out in LEFT_OUT):
                yield path, file.read_text(encoding="utf-8")


def findings(top: Path) -> list[WordFinding]:
    """Return every finding below a folder, by path and line."""
    found: list[WordFinding] = []
    classes: list[tuple[str, str, int]] = []
    for path, text in files(top):
        if path.endswith(".md"):
            found += in_markdown(path, _unreleased(text) if path == "CHANGELOG.md" else text)
            continue
        found += names_in(path, text)
        if not path.startswith(NAMES_ONLY):
            found += in_source(path, text)
            classes += classes_in(path, text) if path.startswith(SOURCE) else ()
    return sorted([*found, *twice(classes)])


def mean_sentence_words(text: str) -> float:
    """Return the mean number of words of a document's sentences; 0 where it has none."""
    counts = [len(sentence.split()) for _, sentence in _sentences(_without_code(text)) if sentence]
    return sum(counts) / len(counts) if counts else 0.0


def _without_code(text: str) -> str:
    """Blank code blocks, fenced and indented, and keep the numbers of the lines."""

    def blank(block: re.Match[str]) -> str:
        return "\n" * block.group().count("\n")

    text = re.sub(r"^```.*?^```", blank, text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"(?<=\n\n)(?: {4}.*\n|\n)+", blank, text)


def _sentences(text: str) -> Iterator[tuple[int, str]]:
    """Yield (line, sentence) of the prose: paragraphs and items of lists, each divided at its stops."""
    prose = re.sub(r"`[^`]*`", _one_word, text)
    prose = re.sub(r"^(?:[ \t]*\||#).*$", "", prose, flags=re.MULTILINE)
    prose = re.sub(
        r"^\s*(?:[-*]|\d+\.) ", lambda item: "\n" * item.group().count("\n") + "\0", prose, flags=re.M
    )
    start = 0
    for stop in re.finditer(r"\n[ \t]*\n|\0|[.!?:][*_)\"”]*(?=\s)|\Z", prose):
        sentence = prose[start : stop.end()].replace("\0", " ")
        lead = len(sentence) - len(sentence.lstrip())
        yield 1 + prose.count("\n", 0, start + lead), sentence.strip()
        start = stop.end()


def _one_word(code: re.Match[str]) -> str:
    return "X" + "\n" * code.group().count("\n")


def _declares_names(node: ast.stmt) -> bool:
    """Return whether the strings of a statement are names: `__all__`."""
    return isinstance(node, ast.Assign) and any(
        isinstance(target, ast.Name) and target.id == "__all__" for target in node.targets
    )


def _is_sentence(docstring: str | None) -> bool:
    first = (docstring or "").split("\n\n")[0].strip()
    return len(first.split()) >= MIN_DOCSTRING_WORDS and first.endswith((".", "!", "?", ":"))


def _unreleased(changelog: str) -> str:
    """Return the first section: what is released stays as it was published."""
    sections = re.split(r"(?m)^(?=## )", changelog)
    return "".join(sections[:2])


def main(arguments: Sequence[str]) -> int:
    """Print the findings, or their counts. Return 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", action="store_true", help="print counts by room and rule only")
    options = parser.parse_args(arguments)
    found = findings(TOP)
    if options.count:
        rooms: Counter[str] = Counter("/".join(Path(one.path).parts[:3]) for one in found)
        for name, count in [*Counter(one.rule for one in found).most_common(), *rooms.most_common()]:
            print(f"{count:5d}  {name}")
        for path, text in files(TOP):
            if path.endswith(".md") and path != "CHANGELOG.md":
                print(f"{mean_sentence_words(text):5.1f}  words a sentence in {path}")
    else:
        print(*found, sep="\n", end="\n" if found else "")
    print(f"{len(found)} findings", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
