"""Names of the package's numbers: a noun and its unit, since one word tells neither what it limits nor in what."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import dqreg

PACKAGE = Path(dqreg.__file__).parent
# Rooms where a number may still have one word: this list only shrinks.
OPEN = {"kernels", "registration", "trust"}
# What one word tells beside the name of its module: flags, codes of a format, counts of one thing.
CLEAR = {
    "files.gltf_guards": {"FLOAT32"},
    "geometry.exports": {"FLOAT32", "FLOAT64"},
    "inspection.membership.membership": {"BEYOND", "OUTLIER", "EXCLUDED"},
    "multiway.refinement.common_planes": {"ROUNDS"},
    "multiway.pose_graph.edges": {"PART"},
    "multiway.turntables.symmetric_part": {"PRIMES"},
    "odometry.map_file": {"VERSION"},
    "odometry.map_surface": {"COUNTERS"},
    "odometry.unseen_rotations": {"SHORTLIST"},
    "studio.visit": {"VERSION"},
}
# Functions of numbers that are numbers.
FUNCTIONS = {"abs", "cos", "deg2rad", "exp", "float", "int", "log", "max", "min", "radians", "sin", "sqrt", "tan"}


def is_number(node: ast.expr) -> bool:
    """Whether an expression is a number that is written there, or a tuple of such, scaled or through functions too."""
    match node:
        case ast.Constant(value):
            return isinstance(value, (int, float)) and not isinstance(value, bool)
        case ast.Tuple(elts):
            return all(map(is_number, elts))
        case ast.UnaryOp(operand=operand):
            return is_number(operand)
        case ast.BinOp(left, _, right):
            return is_number(left) or is_number(right)
        case ast.Call(func, args):
            return ast.unparse(func).split(".")[-1] in FUNCTIONS and any(map(is_number, args))
    return False


def numbers_of(tree: ast.Module) -> Iterator[str]:
    """Names that a module gives to numbers."""
    for node in tree.body:
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            for name, value in zip(target.elts, node.value.elts, strict=True) if both else [(target, node.value)]:
                if isinstance(name, ast.Name) and name.id.isupper() and is_number(value):
                    yield name.id


def test_numbers_of_a_module_are_found() -> None:
    text = (
        'A, B = 1, "b"\nC: float = -math.cos(np.deg2rad(2.0))\nD = (1, 2.5)\nE = 2 * np.pi\nF = [1]\nG = True\n'
        "h = 1\nI = f(1)\nJ = 1 << 13"
    )
    assert list(numbers_of(ast.parse(text))) == ["A", "C", "D", "E", "J"]


def test_a_number_has_a_name_of_two_words() -> None:
    found: dict[str, set[str]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(file.relative_to(PACKAGE).with_suffix("").parts)
        for number in numbers_of(ast.parse(file.read_text(encoding="utf-8"))):
            if "_" not in number.strip("_"):
                found.setdefault(name, set()).add(number)
    # What is no longer there leaves the lists.
    assert {name: numbers for name, numbers in found.items() if name.split(".")[0] not in OPEN} == CLEAR
    assert {name.split(".")[0] for name in found} >= OPEN
