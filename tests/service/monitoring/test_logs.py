"""How log lines look, line by line."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator
from datetime import datetime

import pytest

from caesura_service.monitoring.logs import FIELDS, FORMATTERS, UnknownOption, log_to


@pytest.fixture
def logger() -> Iterator[logging.Logger]:
    one = logging.getLogger("caesura_service.test_logs")
    one.propagate = False
    one.setLevel(logging.INFO)
    yield one
    one.handlers.clear()


def written(logger: logging.Logger, log_format: str) -> io.StringIO:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(FORMATTERS[log_format]("west"))
    logger.addHandler(handler)
    return stream


def test_a_line_of_json_has_who_and_where_as_fields(logger):
    stream = written(logger, "json")
    logger.info("%s/%s opened", "cell-1", "s1", extra={"station": "cell-1", "session": "s1"})
    logger.info("two\nlines")
    first, second = map(json.loads, stream.getvalue().splitlines())
    assert tuple(first)[:5] == FIELDS
    assert datetime.fromisoformat(first.pop("time")).tzinfo is not None
    assert first == {
        "level": "INFO",
        "logger": "caesura_service.test_logs",
        "instance": "west",
        "message": "cell-1/s1 opened",
        "station": "cell-1",
        "session": "s1",
    }
    assert second["message"] == "two\nlines"


def test_an_exception_is_a_field_of_its_line(logger):
    stream = written(logger, "json")
    try:
        raise RuntimeError("no such thing – leider")
    except RuntimeError:
        logger.exception("it broke")
    (line,) = stream.getvalue().splitlines()
    assert "RuntimeError: no such thing – leider" in json.loads(line)["exception"]


def test_a_line_for_people_names_the_instance(logger):
    stream = written(logger, "text")
    logger.warning("cell-1/s1 gap")
    assert stream.getvalue().endswith(" WARNING west caesura_service.test_logs: cell-1/s1 gap\n")


@pytest.mark.parametrize(("level", "log_format"), [("loud", "text"), ("info", "xml")])
def test_what_is_unknown_is_named(level, log_format):
    with pytest.raises(UnknownOption, match=r"(loud|xml)', known: "):
        log_to(io.StringIO(), level=level, log_format=log_format, instance="west")
