"""Everything public is documented, the examples run, and the stub matches the package."""

import ast
import doctest
import inspect
import re
from importlib import resources
from pathlib import Path

import pytest

import conduit_ring
from conduit_ring import _native, frames

GUIDE = Path(__file__).parents[3] / "docs/guides/python.md"
EXAMPLES = re.findall(r"^```python\n(.*?)^```", GUIDE.read_text(), re.M | re.S)
PUBLIC = [getattr(conduit_ring, name) for name in conduit_ring.__all__]


@pytest.mark.parametrize(
    "module", [conduit_ring, _native, frames], ids=lambda module: module.__name__
)
def test_examples_in_docstrings_run(module):
    names = {name: getattr(conduit_ring, name) for name in conduit_ring.__all__}
    runner = doctest.DocTestRunner()
    tests = doctest.DocTestFinder().find(module, globs={**names, **vars(module)})
    found = [test for test in tests if test.examples]
    assert found
    for test in found:
        assert runner.run(test).failed == 0


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_examples_in_the_guide_run(example, capsys):
    exec(compile(example, str(GUIDE), "exec"), {"__name__": "__main__"})


def test_everything_public_is_documented():
    for item in PUBLIC:
        assert inspect.getdoc(item), item
        if inspect.isclass(item) and item.__module__ == "conduit_ring":
            for name, member in vars(item).items():
                assert name.startswith("_") or inspect.getdoc(member), f"{item.__name__}.{name}"


def test_the_stub_declares_the_members_of_the_package():
    stub = ast.parse((resources.files("conduit_ring") / "_native.pyi").read_text())
    stated = {}
    for node in stub.body:
        if isinstance(node, ast.ClassDef):
            stated[node.name] = {part.name for part in node.body}
        elif isinstance(node, ast.FunctionDef):
            stated[node.name] = None
    for name in conduit_ring.__all__:
        item = getattr(conduit_ring, name)
        if not inspect.isclass(item):
            assert name in stated
        elif item.__module__ == "conduit_ring":
            real = {part for part in vars(item) if not part.startswith("_")}
            assert {part for part in stated[name] if not part.startswith("_")} == real


def test_the_package_is_marked_as_typed():
    assert (resources.files("conduit_ring") / "py.typed").is_file()
