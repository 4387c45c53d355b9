"""Expressions of studies: they compute, and can do nothing else."""

import math

import pytest

from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import Expression

NAMES = {"force": 12.0, "tips": {"finger": [1.0, 2.0, 3.0]}, "held": True, "nothing": None}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("force / 4 + 2 ** 3", 11.0),
        ("-tips['finger'][2] if held and not force < 3 else 0", -3.0),
        ("hypot(tips['finger'][0], tips['finger'][1])", math.sqrt(5.0)),
        ("get(tips, 'thumb', 7) + max(1, 2, 3) % 2", 8.0),
        ("2 < force <= 12", 1.0),
        ("degrees(pi)", 180.0),
    ],
)
def test_expression_has_its_value(text: str, value: float) -> None:
    assert Expression(text, "key")(NAMES) == pytest.approx(value)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "open('/etc/passwd')",
        "(1).__class__",
        "tips.clear()",
        "[x for x in (1, 2)]",
        "lambda: 1",
        "f'{force}'",
        "(force := 3)",
        "eval('1')",
        "max(*tips)",
        "b'x'",
        "1; 2",
        "get(key=1)",
        "()" * 600,
        "a" + ".b" * 490 + "(1)",
        "a" + "()" * 490,
        "(1" + "+1" * 490 + ")(1)",
        "a" + ".b[0]" * 190 + "(1)",
    ],
)
def test_code_is_refused(text: str) -> None:
    with pytest.raises(StudyError, match=r"^key"):
        Expression(text, "key")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("forse + 1", "there is no 'forse'; did you mean 'force'?"),
        ("tips['fingr']", "there is no 'fingr'; did you mean 'finger'?"),
        ("tips['finger'][3]", "entry 3 does not exist"),
        ("force / 0", "division by zero"),
        ("9.0 ** 9.0 ** 9.0", "math range error"),
        ("nothing + 1", "must be a string or a real number"),
        ("tips", "must be a string or a real number"),
        ("get(force, 'a', 0)", "'float' object has no attribute 'get'"),
        ("-" * 900 + "1", "is nested too deeply; 100 levels are the most"),
    ],
)
def test_uncomputable_expression_is_one_line(text: str, problem: str) -> None:
    with pytest.raises(StudyError) as refused:
        Expression(text, "objectives.force")(NAMES)
    assert problem in str(refused.value)
    assert str(refused.value).startswith(f"objectives.force = {text!r}: ")


def test_constraint_is_violated_by_a_difference() -> None:
    assert Expression("force <= 10", "c").violation(NAMES) == 2.0
    assert Expression("force >= 10", "c").violation(NAMES) == -2.0
    with pytest.raises(StudyError, match="both must be finite numbers"):
        Expression("huge >= 10", "c").violation({"huge": math.nan})
    with pytest.raises(StudyError, match="must compare two values"):
        Expression("force", "c").violation(NAMES)
