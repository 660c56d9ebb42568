"""The checker of words: every rule finds a bad example and passes a good one."""

from __future__ import annotations

from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[2]

LONG = " ".join(["word"] * 31) + "."
BAD_AND_GOOD = [
    ("nameless-actor", "The batch waits until somebody asks.", "The batch waits until a reader asks."),
    ("nameless-owner", "The station is ours.", "This instance owns the station."),
    ("code-that-talks", "A status tells the time.", "A status states the time."),
    ("code-that-hears", "The last status that was heard.", "The last status received."),
    ("code-that-knows", "A service that knows the session.", "A service that holds the session."),
    ("code-that-feels", "The intake forgives the sender.", "The intake resets the back-off of the sender."),
]


@pytest.fixture
def words(script):
    return script("check_words")


def rules(found) -> list[str]:
    return [one.rule for one in found]


@pytest.mark.parametrize(("rule", "bad", "good"), BAD_AND_GOOD)
def test_a_ruled_out_word_is_found_in_docs_docstrings_comments_and_strings(words, rule, bad, good):
    def places(text: str) -> list[list[str]]:
        docstring, comment, error = f'"""{text}"""', f"# {text}", f'raise ValueError(f"{{x}}: {text}")'
        module = '"""A module of one sentence."""\n'
        return [
            rules(words.in_markdown("docs/a.md", text)),
            rules(words.in_source("a.py", docstring)),
            rules(words.in_source("a.py", module + comment)),
            rules(words.in_source("a.py", module + error)),
        ]

    assert places(bad) == [[rule]] * 4
    assert places(good) == [[]] * 4


def test_every_rule_for_words_has_an_example(words):
    assert {rule for rule, _, _ in BAD_AND_GOOD} == set(words.RULES)


def test_names_and_code_are_not_words(words):
    source = '"""Holds `told` and nothing else."""\n__all__ = ["heard"]\ntold = heard = 1\nprint(f"{told}")\n'
    assert rules(words.in_source("a.py", source)) == []
    assert rules(words.in_markdown("docs/a.md", "Run `tell`.\n\n    somebody\n\n```\nours\n```\n")) == []


@pytest.mark.parametrize(
    "source",
    [
        "def test_a_sender_is_told(): ...",
        "async def told(): ...",
        "class SomebodyElse: ...",
        "def f(told): ...",
        "lambda told: 1",
        "a.told = 1",
        "for told in (): ...",
    ],
)
def test_a_ruled_out_word_in_a_name_is_found_where_the_name_is_given(words, source):
    assert len(rules(words.names_in("a.py", source))) == 1
    assert rules(words.names_in("a.py", "def f(): return told.untold(heard)")) == []


def test_the_names_of_tests_are_checked_and_their_texts_are_not(words, tmp_path):
    (tmp_path / "tests").mkdir()
    for room in words.ROOMS:
        (tmp_path / room).touch() if "." in room else (tmp_path / room).mkdir()
    (tmp_path / "tests" / "test_a.py").write_text("def test_it_is_told():\n    return 'told'\n")
    assert [str(one)[:45] for one in words.findings(tmp_path)] == [
        "tests/test_a.py:1: name test_it_is_told (code"
    ]


def test_a_finding_has_the_line_of_its_word(words):
    source = '"""A module of one sentence.\n\nIt knows.\n"""\n\nx = 1  # told\n'
    assert [(one.line, one.rule) for one in words.in_source("a.py", source)] == [
        (3, "code-that-knows"),
        (6, "code-that-talks"),
    ]


@pytest.mark.parametrize(
    "text",
    [
        LONG,
        LONG.replace("word", "word;", 1),
        f"- short\n- {LONG}\n",
        f"A paragraph.\n\n{LONG}\n",
        f"1. {LONG}",
    ],
)
def test_a_sentence_of_31_words_is_found(words, text):
    assert rules(words.in_markdown("docs/a.md", text)) == ["long-sentence"]


@pytest.mark.parametrize(
    "text",
    [
        " ".join(["word"] * 30) + ".",
        f"{LONG[:-1].replace('word word word', 'word word. word', 1)}.",
        f"{LONG[:-1].replace('word word word', 'word word: word', 1)}.",
        f"    {LONG}\n".join(["Code:\n\n", "\n"]),
        f"```\n{LONG}\n```\n",
        f"| {LONG} |\n",
        "`" + LONG + "`",
        "- ten words\n" * 10,
    ],
)
def test_short_sentences_tables_and_code_pass(words, text):
    assert rules(words.in_markdown("docs/a.md", text)) == []


def test_a_class_name_may_occur_once(words):
    one = list(words.classes_in("a.py", "class Step: ...\nclass Pose:\n    class Part: ...\n"))
    other = list(words.classes_in("b.py", "class Part: ...\n"))
    assert rules(words.twice(one)) == []
    assert [(found.path, found.line) for found in words.twice([*one, *other])] == [("a.py", 3), ("b.py", 1)]


@pytest.mark.parametrize("text", ["x = 1\n", '"""Words."""\n', '"""Words without a full stop"""\n'])
def test_a_module_opens_with_a_sentence(words, text):
    assert rules(words.in_source("a.py", text)) == ["module-docstring"]
    assert rules(words.in_source("a.py", '"""Words with a full stop."""\nx = 1\n')) == []


def test_every_room_is_there(words):
    assert [room for room in [*words.ROOMS, *words.LEFT_OUT] if not (TOP / room).exists()] == []
    assert all(len(reason.split()) >= 3 for reason in words.LEFT_OUT.values())


def test_the_mean_length_of_sentences_leaves_out_code_tables_and_headings(words):
    page = "# A title of many words\n\nOne two three. Four\nfive.\n\n    code in a block\n\n| a | b c d |\n"
    assert words.mean_sentence_words(page) == 2.5
    assert words.mean_sentence_words("# Only a title\n") == 0.0


@pytest.mark.parametrize(
    ("docstring", "found"),
    [
        ("What is left.", ["docstring-opening"]),
        ("Is it a hold?", ["docstring-opening"]),
        ("Whether it is a hold.", []),
        ("Return the iterations.", []),
        ("Isolated samples.", []),
        ("", []),
    ],
)
def test_a_docstring_opens_with_no_question_and_no_clause(words, docstring, found):
    text = f'"""A module of one function."""\n\ndef held():\n    """{docstring}"""\n'
    assert [one.rule for one in words.in_source("a.py", text)] == found
