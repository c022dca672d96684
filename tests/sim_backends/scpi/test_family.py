"""The list of a family's headers, and how a header that was sent is found in it."""

import pytest

from sim_backends.scpi.family import Family

LIST = """\
% a comment
*LRN ?
CURSor ?
 FUNCtion !?
MEASUrement
 DELay
  EDGE# !?
  EDGE2 !
SOURce
 FREQuency !?
SOURce#
 SKEW !
"""


@pytest.mark.parametrize(
    ("sent", "query", "known"),
    [
        ("*lrn", True, "*LRN"),
        ("*LRN", False, None),
        ("curs:func", True, "CURSor:FUNCtion"),
        ("CURSor:FUNCtion", False, "CURSor:FUNCtion"),
        ("CURSO:FUNCtion", False, None),
        ("CURSor:FUNCtion:MORE", False, None),
        ("MEASUrement", True, None),
        ("MEASU:DEL:EDGE1", True, "MEASUrement:DELay:EDGE#"),
        ("MEASU:DEL:EDGE2", True, "MEASUrement:DELay:EDGE#"),
        ("MEASU:DEL:EDGE", True, None),
        ("SOURce2:SKEW", False, "SOURce#:SKEW"),
        ("", False, None),
    ],
)
def test_a_header_is_found_by_every_spelling(sent: str, query: bool, known: str | None) -> None:
    assert Family(LIST, suffix_required=True).known(sent, query=query) == known


def test_a_suffix_may_be_left_out_where_the_family_allows_it() -> None:
    family = Family(LIST, suffix_required=False)
    assert family.known("SOURce:SKEW", query=False) == "SOURce#:SKEW"
    assert family.known("SOURce:FREQuency", query=True) == "SOURce:FREQuency"


def test_the_whole_list_in_its_order() -> None:
    assert list(Family("A\n B !?\nC ?\n", suffix_required=True)) == [("A:B", False), ("A:B", True), ("C", True)]
