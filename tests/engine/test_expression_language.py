"""Expressions: they mean what they mean in Python, and whatever else is written is refused in one line."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from taichisoft.base import CANNOT_BE_COMPUTED, ExpressionError, evaluate, read_expression
from taichisoft.base.expressions import CONSTANTS, DEEPEST_NESTING, FUNCTIONS, LONGEST_TEXT

NAMES: dict[str, Any] = {"a": 3.0, "b": -0.5, "zero": 0.0, "table": {"x y": [1.0, 2.5]}}


def value(text: str) -> Any:
    return evaluate(read_expression(text), NAMES)


LEAVES = st.sampled_from(["a", "b", "zero", "pi", "table['x y'][1]"]) | st.floats(0, 1e3, allow_subnormal=False).map(
    repr
)
NUMBERS: st.SearchStrategy[str] = st.deferred(
    lambda: (
        LEAVES
        | st.builds("({} {} {})".format, NUMBERS, st.sampled_from("+-*/"), NUMBERS)
        | st.builds("({}{})".format, st.sampled_from("+-"), NUMBERS)
        | st.builds("({} if {} else {})".format, NUMBERS, TRUTHS, NUMBERS)
        | st.builds("{}({})".format, st.sampled_from(["abs", "sqrt", "exp", "sin", "degrees"]), NUMBERS)
        | st.builds("{}({}, {})".format, st.sampled_from(["min", "max", "atan2", "hypot"]), NUMBERS, NUMBERS)
    )
)
SIGNS = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])
TRUTHS: st.SearchStrategy[str] = st.deferred(
    lambda: (
        st.builds("({} {} {})".format, NUMBERS, SIGNS, NUMBERS)
        | st.builds("({} {} {} {} {})".format, NUMBERS, SIGNS, NUMBERS, SIGNS, NUMBERS)
        | st.builds("({} {} {})".format, TRUTHS, st.sampled_from(["and", "or"]), TRUTHS)
        | st.builds("(not {})".format, TRUTHS)
    )
)


def outcome(compute: Callable[[], Any]) -> Any:
    """A value, or the kind of what went wrong."""
    try:
        found = compute()
    except CANNOT_BE_COMPUTED as error:
        return type(error)
    return "NaN" if math.isnan(found) else found


@given((NUMBERS | TRUTHS).filter(lambda text: len(text) <= LONGEST_TEXT))
@example("zero != 0 and 1 / zero > 1")
@example("a < b < 1 / zero")
@example("1 / zero if zero else 5.0")
def test_it_means_what_python_means(text: str) -> None:
    """Python's own arithmetic is the reference: the same bits, and the same parts that are not looked at."""
    expected = outcome(lambda: eval(text, {**FUNCTIONS, **CONSTANTS}, NAMES))
    assert outcome(lambda: value(text)) == expected


PIECES = [*"()[]<>=!+-*/.,:;'\"\\#@{}%&|^~0123456789ej\n\t\0", *NAMES, *FUNCTIONS, "'x y'", " and ", " or ", " not "]
PIECES += [" if ", " else ", " is ", "lambda ", "__import__", "open", "__class__", "True", "None", "f'", "1e999"]


@given(st.text() | st.lists(st.sampled_from(PIECES), max_size=30).map("".join))
@example("\x0c a + 1")
@example("0x1for x")
@example("table['\\d']")
@example("9 ** 9 ** 9 ** 9")
@example("get(table, table, 1)")
@example("get(table, [], 1)")
def test_whatever_is_written_is_a_value_or_one_line(text: str) -> None:
    try:
        value(text)
    except ExpressionError as error:
        assert len(str(error).splitlines()) == 1
    except CANNOT_BE_COMPUTED:
        pass


def test_powers_are_those_of_floats() -> None:
    """Of whole numbers they could fill the memory."""
    assert value("2 ** 0.5") == math.sqrt(2.0)
    with pytest.raises(OverflowError):
        value("9 ** 9 ** 9")


def test_an_expression_goes_on_in_further_lines() -> None:
    assert value("a\n  + 1\n") == 4.0


@pytest.mark.parametrize("deep", ["-" * 300 + "1", "1" + " + 1" * 200, "(" * 90 + "a" + ")" * 90 + "[0]" * 200])
def test_what_is_deep_is_refused_before_it_is_evaluated(deep: str) -> None:
    with pytest.raises(ExpressionError, match=f"{DEEPEST_NESTING} levels are the most"):
        read_expression(deep)


def test_what_is_as_deep_as_can_be_is_evaluated() -> None:
    assert value("1" + " + 1" * (DEEPEST_NESTING - 2)) == DEEPEST_NESTING - 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "not understood"),
        ("a +", "not understood at the end: invalid syntax"),
        ("a b", "not understood at character "),
        ("a" * (LONGEST_TEXT + 1), f"has {LONGEST_TEXT + 1} characters; {LONGEST_TEXT} are the most"),
        ("c + 1", "there is no 'c'; there are: a, b, zero, table"),
        ("tabel['x y']", "there is no 'tabel'; did you mean 'table'?"),
        ("table['xy']", "there is no 'xy'; did you mean 'x y'?"),
        ("table['x y'][7]", "entry 7 does not exist"),
        ("open('a')", "open: unknown function; there are: get, abs"),
        ("a.real", "expressions have no Attribute"),
        ("[a]", "expressions have no List"),
        ("None", "expressions have no None"),
        ("a // 2", "expressions have no FloorDiv"),
    ],
)
def test_a_refusal_says_what_is_wrong_and_what_would_be_valid(text: str, problem: str) -> None:
    with pytest.raises(ExpressionError) as refused:
        value(text)
    assert problem in str(refused.value)
