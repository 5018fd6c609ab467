"""Public functions, methods and classes say which errors they raise and show an example; what does not is listed here.

Raises is not asked of a property, nor of a method without arguments whose body raises nothing; of a class only where it
checks what it is made of. The Raises of a class may speak for its methods ("methods", or their names). An example is
not asked of a property. A method may be shown in the example of its class; a record by an example that makes it or of
what returns it, or by a record that holds it. A protocol is shown, and raises, as what keeps it.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.test_docstrings import NAMES, found

# They take anything, or arrays and records that other calls have checked: none raises an error on purpose.
RAISE_NOTHING = {
    "dqreg.geometry.cloud_surface.CloudSurface.on_rim",
    "dqreg.geometry.mesh_surface.MeshSurface",
    "dqreg.geometry.scan.Scan.even_rows",
    "dqreg.geometry.scan.Scan.taken",
    "dqreg.geometry.scan.Scan.thinned",
    "dqreg.inspection.deviations.files.colours_of",
    "dqreg.inspection.deviations.deviations.Deviations.normals",
    "dqreg.inspection.deviations.deviations.Deviations.pose_sigma",
    "dqreg.inspection.features.feature.Feature.sigma",
    "dqreg.inspection.deviations.outward_side.why_unsigned",
    "dqreg.inspection.part_faces.part_faces",
    "dqreg.inspection.plan.report.PlannedReport.draws",
    # What would be no pose becomes a failed result.
    "dqreg.registration.result.result.Registration",
    "dqreg.rigid.pose.random",
    "dqreg.rigid.screw.DualNumber.extend",
    "dqreg.synth.cameras.Stands.projector_positions",
    "dqreg.synth.cameras.Stands.sensor_positions",
    "dqreg.synth.motion.Motion.twist",
    "dqreg.synth.patterns.StructuredLight.projector_positions",
    "dqreg.trust.covariance.covariance_of",
    "dqreg.trust.covariance.observe_directions",
    "dqreg.trust.covariance.without_free_motion",
    "dqreg.trust.evidence.Evidence.length",
    "dqreg.trust.information.information_of",
    "dqreg.trust.verdict.judge",
}
# What they need may be absent where the examples run: PyVista, SciPy 1.16.
NEED_MORE = {
    "dqreg.geometry.cloud.PointCloud.to_pyvista",
    "dqreg.geometry.mesh.Mesh.to_pyvista",
    "dqreg.inspection.deviations.deviations.Deviations.to_pyvista",
    "dqreg.rigid._dual_action.DualAction.as_rigid_transform",
    "dqreg.rigid.pose.to_rigid_transform",
}


def entries() -> dict[str, tuple[Any, type | None]]:
    """All that is public, by module and qualified name, and the class of a method or property."""
    values: dict[str, tuple[Any, type | None]] = {}
    for name in NAMES:
        value, owner = found(name)
        # Of a method, what stands in the source: under its decorator, and in the class where it is written.
        raw = next((getattr(value, key) for key in ("__func__", "fget", "func") if hasattr(value, key)), value)
        if inspect.isfunction(raw) or (inspect.isclass(raw) and not issubclass(raw, Exception)):
            if getattr(owner or raw, "_is_protocol", False):
                continue
            bare = inspect.unwrap(raw)
            is_method = raw is value or isinstance(value, (classmethod, staticmethod))
            values.setdefault(f"{bare.__module__}.{bare.__qualname__}", (bare if is_method else value, owner))
    return values


def is_property(value: Any) -> bool:
    return not inspect.isfunction(value) and not inspect.isclass(value)


def section(value: Any, name: str) -> str:
    """Text of a section of a docstring; empty where there is none."""
    text = re.search(rf"^{name}\n-+\n(.*?)(?=^[A-Z][\w ]*\n-+$|\Z)", inspect.getdoc(value) or "", re.M | re.S)
    return text[1] if text else ""


def has_example(value: Any) -> bool:
    return ">>>" in section(value, "Examples")


def bases(cls: type) -> list[type]:
    return [base for base in inspect.getmro(cls) if base.__module__.startswith("dqreg.")]


def checks(cls: type) -> bool:
    """Whether a class does more as it is made than to keep, and lock, what it is given."""
    own = [
        vars(base)[key].__code__ for base in bases(cls) for key in ("__post_init__", "__init__") if key in vars(base)
    ]
    return any(code.co_names != ("lock",) for code in own if code.co_filename != "<string>")


def may_raise(value: Any) -> bool:
    if is_property(value):
        return False
    if inspect.isclass(value):
        return checks(value)
    taken = [each for each in inspect.signature(value).parameters if each not in ("self", "cls")]
    return bool(taken) or bool(re.search(r"^\s*raise ", inspect.getsource(value), re.M))


def is_said_by_class(value: Any, owner: type | None) -> bool:
    said = section(owner, "Raises") if owner else ""
    return "methods" in said or f"`{value.__name__}`" in said if said else False


def is_shown_by_class(value: Any, owner: type | None) -> bool:
    return owner is not None and f".{value.__name__}(" in section(owner, "Examples")


def shown_records(values: dict[str, tuple[Any, type | None]]) -> set[str]:
    """Names of classes that examples hand out or make: returned by what has one, or held by another of them."""
    classes = {value.__name__: value for value, _ in values.values() if inspect.isclass(value)}
    shown, new = set[str](), set[str]()
    for value, owner in values.values():
        if inspect.isfunction(value) and (has_example(value) or is_shown_by_class(value, owner)):
            new |= words_of(value.__annotations__.get("return", ""))
        if inspect.isclass(value) and has_example(value):
            new.add(value.__name__)
    examples = "".join(section(value, "Examples") for value, _ in values.values())
    new |= set(re.findall(r"\b([A-Z]\w+)\(", examples))
    while new := (new & set(classes)) - shown:
        shown |= new
        new = {word for name in new for held in held_by(classes[name]) for word in words_of(held)}
    return shown


def words_of(annotation: Any) -> set[str]:
    return set(re.findall(r"\w+", annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")))


def held_by(cls: type) -> Iterator[Any]:
    """Annotations of the fields and properties of a class, and of what its methods return."""
    for base in bases(cls):
        yield from inspect.get_annotations(base).values()
        for member in vars(base).values():
            raw = getattr(member, "fget", None) or getattr(member, "func", None) or member
            if inspect.isfunction(raw) and raw.__name__[0] != "_":
                yield raw.__annotations__.get("return", "")


@pytest.mark.filterwarnings("ignore:dqreg.trust:DeprecationWarning")
def test_what_raises_says_so() -> None:
    silent = {
        name
        for name, (value, owner) in entries().items()
        if may_raise(value) and not section(value, "Raises") and not is_said_by_class(value, owner)
    }
    assert silent == RAISE_NOTHING


@pytest.mark.filterwarnings("ignore:dqreg.trust:DeprecationWarning")
def test_all_have_an_example() -> None:
    values = entries()
    shown = shown_records(values)
    bare = {
        name
        for name, (value, owner) in values.items()
        if not is_property(value) and not has_example(value) and not is_shown_by_class(value, owner)
        if not (inspect.isclass(value) and value.__name__ in shown)
    }
    assert bare == NEED_MORE
