"""Kernels and the functions that they call take bundles, so that none needs a dozen parameters."""

import ast
from pathlib import Path

import pytest

import taichisoft

ENGINE = Path(taichisoft.__file__).parent
KERNELS = sorted([*ENGINE.glob("**/kernels/*.py"), *ENGINE.glob("runtime/*.py")])
MOST_PARAMETERS = 12


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: str(path.relative_to(ENGINE)))
def test_no_function_has_more_than_twelve_parameters(path: Path) -> None:
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    assert not [one.name for one in functions if len(one.args.args) > MOST_PARAMETERS]
