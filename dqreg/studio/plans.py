"""The visit as an inspection plan, and a plan as a visit: what the page can show is chosen there, the rest is kept."""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from typing import Any

from dqreg.errors import InputError
from dqreg.inspection.plan.file import HEAD, plan_of
from dqreg.studio.visit import FaceTolerance, PlaneCut, Reference, Visit

LETTERS = "ABC"
NAMES = {"faces": "chosen faces", "points": "reference points"}
GOALS = ("best-fit", "tolerance", "minimax")
NOTE = "# Faces are those of `dqreg faces`.\n"
MOST_TEXT = 1 << 18

Values = dict[str, Any]


def is_judged(visit: Visit) -> bool:
    """Whether there is something to decide, and so a plan."""
    rest = _rest(visit)
    return visit.tolerance is not None or bool(visit.faces or rest.get("face") or rest.get("characteristic"))


def plan_text(visit: Visit) -> str:
    """The plan in TOML: tolerances, the alignment they are judged under, sections, head, characteristics."""
    return NOTE + _toml(plan_values(visit))


def plan_values(visit: Visit) -> Values:
    """The values of the plan's file."""
    rest = _rest(visit)
    own: Values = {}
    if visit.part is not None and visit.part.units is not None:
        own["units"] = visit.part.units
    if visit.tolerance is not None:
        own |= {**_sides(visit.tolerance, visit.minus), "required": visit.required}
    if visit.alignment != "plan":
        rest.pop("alignment", None)
        own |= _alignment(visit, rest)
    if visit.head:
        rest["head"] = {**rest.get("head", {}), **dict(visit.head)}
    if visit.faces:
        own["face"] = [{"face": row.face, **_sides(row.tolerance, row.minus)} for row in visit.faces]
    if visit.sections:
        own["section"] = [
            {"name": f"section {k}", "point": [*each.point], "normal": [*each.normal]}
            for k, each in enumerate(visit.sections, 1)
        ]
    return rest | own


def with_plan(visit: Visit, text: str) -> Visit:
    """The visit judged by a plan; `InputError` names what is wrong in it."""
    if len(text) > MOST_TEXT:
        raise InputError(f"a plan has {MOST_TEXT} letters at most; got {len(text)}")
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the plan is no TOML: {error}") from error
    plan_of(values)
    visit = dataclasses.replace(
        visit, plan="", tolerance=None, minus=None, required=95.0, faces=(), sections=(), alignment="best-fit",
        chosen=(), weights=(), goal="best-fit", datums=(), references=(), head=(),
    )  # fmt: skip
    unit, named = values.get("units"), None if visit.part is None else visit.part.units
    if unit is not None and named is not None and unit != named:
        raise InputError(f"the plan is in {unit} and the part in {named}: write the plan in {named}")
    for take in (_take_tolerance, _take_alignment, _take_faces, _take_sections, _take_head):
        visit = take(visit, values)
    return dataclasses.replace(visit, plan=_toml(values))


def _rest(visit: Visit) -> Values:
    """What of the plan the page has no field for."""
    return tomllib.loads(visit.plan)


def _sides(plus: float, minus: float | None) -> Values:
    return {"tolerance": plus} if minus is None else {"plus": plus, "minus": minus}


def _both(entry: Values) -> tuple[float, float | None]:
    """A tolerance of a plan as the page has it."""
    if "tolerance" in entry:
        return float(entry["tolerance"]), None
    return float(entry.get("plus", 0.0)), float(entry.get("minus", 0.0))


def _alignment(visit: Visit, rest: Values) -> Values:
    """What the judgement rests on: nothing for the best fit on the whole part."""
    if visit.alignment == "datums":
        return {"datum": [{"name": a, "face": f} for a, f in zip(LETTERS, visit.datums, strict=False)]}
    if visit.alignment == "best-fit":
        # Datums that characteristics name would be aligned to.
        return {"alignment": "best-fit"} if rest.get("datum") else {}
    step: Values = {"name": NAMES[visit.alignment]}
    if visit.alignment == "points":
        step |= {"kind": "points", "points": [[*each.point, *each.normal] for each in visit.references]}
        return {"alignment": [step]}
    weights = [*visit.weights, *(1.0 for _ in visit.chosen)][: len(visit.chosen)]
    step |= {"kind": visit.goal, "faces": [*visit.chosen], "weights": weights}
    if visit.goal == "tolerance" and visit.tolerance is not None:
        step |= _sides(visit.tolerance, visit.minus)
    return {"alignment": [step]}


def _take_tolerance(visit: Visit, values: Values) -> Visit:
    entry: Values = {key: values.pop(key) for key in ("tolerance", "plus", "minus") if key in values}
    if not entry:
        return visit
    plus, minus = _both(entry)
    return dataclasses.replace(visit, tolerance=plus, minus=minus, required=float(values.pop("required", 95.0)))


def _take_alignment(visit: Visit, values: Values) -> Visit:
    chosen, datums = values.get("alignment", "datums" if values.get("datum") else "best-fit"), values.get("datum", [])
    if chosen == "best-fit":
        values.pop("alignment", None)
        return visit
    if chosen == "datums":
        plain = all(set(each) == {"name", "face"} and isinstance(each["face"], int) for each in datums)
        if plain and [each["name"] for each in datums] == list(LETTERS[: len(datums)]):
            values.pop("alignment", None)
            found = tuple(each["face"] for each in values.pop("datum"))
            return dataclasses.replace(visit, alignment="datums", datums=found)
        return dataclasses.replace(visit, alignment="plan")
    step = chosen[0]
    if len(chosen) == 1 and step.get("name") in NAMES.values() and not datums:
        if step["kind"] == "points" and all(len(each) == 6 for each in step["points"]):
            del values["alignment"]
            held = tuple(Reference(_triple(each[:3]), _triple(each[3:])) for each in step["points"])
            return dataclasses.replace(visit, alignment="points", references=held)
        if step["kind"] in GOALS and _is_of_page(visit, step):
            del values["alignment"]
            weights = tuple(map(float, step.get("weights", [])))
            goal, faces = step["kind"], tuple(step["faces"])
            return dataclasses.replace(visit, alignment="faces", goal=goal, chosen=faces, weights=weights)
    return dataclasses.replace(visit, alignment="plan")


def _is_of_page(visit: Visit, step: Values) -> bool:
    """Whether a fit on faces says no more than the page does."""
    sides: Values = {key: step[key] for key in ("tolerance", "plus", "minus") if key in step}
    same = not sides or (visit.tolerance is not None and _both(sides) == (visit.tolerance, visit.minus))
    return same and "dof" not in step and all(isinstance(face, int) for face in step.get("faces", [[]]))


def _take_faces(visit: Visit, values: Values) -> Visit:
    rows = values.get("face", [])
    # The last entry that names a face counts: one that the page cannot show keeps all of them in the plan.
    if any("face" not in row or "required" in row for row in rows):
        return visit
    own = {row["face"]: FaceTolerance(row["face"], *_both(row)) for row in values.pop("face", [])}
    return dataclasses.replace(visit, faces=tuple(own[face] for face in sorted(own)))


def _take_sections(visit: Visit, values: Values) -> Visit:
    cuts = values.get("section", [])
    if [each.get("name") for each in cuts] != [f"section {k + 1}" for k in range(len(cuts))] or len(cuts) > 20:
        return visit
    found = tuple(PlaneCut(_triple(each["point"]), _triple(each["normal"])) for each in values.pop("section", []))
    return dataclasses.replace(visit, sections=found)


def _take_head(visit: Visit, values: Values) -> Visit:
    head = values.get("head", {})
    found = tuple((key, str(head.pop(key))) for key in HEAD if key in head)
    if not head:
        values.pop("head", None)
    return dataclasses.replace(visit, head=found)


def _triple(row: list[Any]) -> tuple[float, float, float]:
    x, y, z = map(float, row)
    return x, y, z


def _toml(values: Values) -> str:
    """Values of a plan as TOML: single ones first, then tables, then arrays of tables."""
    single = {k: v for k, v in values.items() if not isinstance(v, dict) and not _is_tables(v)}
    lines = [f"{k} = {_value(v)}" for k, v in single.items()]
    for key, value in values.items():
        if isinstance(value, dict):
            lines += ["", f"[{_key(key)}]", *(f"{_key(k)} = {_value(v)}" for k, v in value.items())]
        elif _is_tables(value):
            for row in value:
                lines += ["", f"[[{key}]]", *(f"{k} = {_value(v)}" for k, v in row.items())]
    return "\n".join([*lines, ""]) if lines else ""


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)


def _key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else json.dumps(key)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    # A basic string of TOML takes the escapes of JSON; dates stand in no plan but as words.
    return str(value) if isinstance(value, int) else json.dumps(str(value))
