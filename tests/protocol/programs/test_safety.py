"""The file of a cell: what is wrong in it is said with field, value and limit."""

from pathlib import Path

import pytest

from caesura_protocol.errors import CaesuraError
from caesura_protocol.programs.safety import Safety, read_safety


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"force_n": -3}', "force_n is -3, expected greater than 0"),
        ('{"force_n": "much"}', "force_n is 'much', expected a valid number"),
        ('{"forse_n": 3}', "unknown field forse_n, known: speed_m_per_s, "),
        ('{"workspace_low": [0, 0]}', "workspace_low.2 is missing"),
        # In mm/s it was 30 m/s, and below 0 the arm looked for a contact backwards, without an end.
        ('{"contact_speed_m_per_s": 30}', "contact_speed_m_per_s is 30, expected"),
        ('{"contact_speed_m_per_s": -0.03}', "contact_speed_m_per_s is -0.03, expected greater than 0"),
        ('{"speed_m_per_s": 250}', "speed_m_per_s is 250, expected"),
        ('{"search_m": 40}', "search_m is 40, expected"),
        ('{"contact_n": 0}', "contact_n is 0, expected greater than 0"),
        (
            '{"contact_n": 40}',
            "the content is {'contact_n': 40}, contact_n is 40 N, expected less: felt_force_n",
        ),
        (
            '{"workspace_low": [0, 0.8, 0]}',
            "the content is {'workspace_low': [0, 0.8, 0]}, workspace_low is above workspace_high in y: 0.8",
        ),
        ("[3]", "the content is [3], expected an object"),
        ("{", "no readable JSON: EOF while parsing an object at line 1 column 1"),
    ],
)
def test_a_wrong_cell_is_named_with_field_value_and_limit(tmp_path, text, said):
    # It once read "Input should be greater than 0" and "Extra inputs are not permitted".
    (tmp_path / "cell.json").write_text(text)
    with pytest.raises(CaesuraError) as refused:
        read_safety(tmp_path / "cell.json")
    assert str(refused.value).startswith(f"{tmp_path / 'cell.json'}: {said}")


def test_a_cell_that_is_no_text_is_named(tmp_path):
    """`--cell demonstration.npz` was a traceback."""
    (tmp_path / "cell.json").write_bytes(b"PK\x03\x04\xff\xfe")
    with pytest.raises(CaesuraError, match=r"cell\.json: no readable JSON"):
        read_safety(tmp_path / "cell.json")


def test_every_limit_of_a_cell_is_in_the_docs():
    page = (Path(__file__).parents[3] / "docs" / "programs.md").read_text(encoding="utf-8")
    table = page.split("## Limits of a cell")[1].split("\n## ")[0]
    assert {name for name in Safety.model_fields if f"`{name}`" not in table} == set()
