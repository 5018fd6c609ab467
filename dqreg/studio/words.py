"""The same without the page: for each step the command line and the Python that do what was chosen, and the plan."""

from __future__ import annotations

import json
import shlex

from dqreg.studio.visit import Visit

CLEANED, START, PLAN = "scan_cleaned.ply", "start.txt", "plan.toml"
LETTERS = "ABC"
ALIGNED = {"faces": "chosen faces", "points": "reference points"}
READ = "from dqreg.files import read_geometry\n\n"
AGAIN = "dqreg studio --replay visit.json --out ."
REPLAY = "from dqreg.studio import replay\n\nreplay('visit.json', '.')"
NOTHING = "# nothing is left out"


def words_of(visit: Visit) -> dict[str, dict[str, str]]:
    """Command and Python of every step, by its name; none where its files are missing."""
    if visit.scan is None or visit.part is None:
        return {}
    register, call = _register(visit)
    return _begun(visit, register, call) | {"judge": _judged(visit, register, call), "report": _report(visit, register)}


def _judged(visit: Visit, register: str, call: str) -> dict[str, str]:
    reach = "" if visit.reach is None else f" --reach {visit.reach!r}"
    given = "" if visit.reach is None else f"reach={visit.reach!r}"
    head = "import dqreg\nimport dqreg.inspection\n\n"
    if not is_judged(visit):
        if visit.alignment != "best-fit" or visit.sections:
            # Without a tolerance there is no plan that would say under which alignment nothing is decided.
            return {"command": AGAIN, "python": REPLAY}
        python = f"{head}{call}\nprint(result.deviations({given}).summary())"
        return {"command": f"{register} --deviations deviations.csv{reach}", "python": python}
    python = (
        f'{head}{call}\nplan = dqreg.inspection.read_plan("{PLAN}")\n'
        f"found = dqreg.inspection.inspect(result.deviations({given}), plan)\nprint(found.outcome, found.decision)"
    )
    return {"command": f"{_inspect(register)}{reach}", "python": python}


def _report(visit: Visit, register: str) -> dict[str, str]:
    if visit.labels or visit.views or (not is_judged(visit) and (visit.alignment != "best-fit" or visit.sections)):
        # Labels and pictures that were chosen by eye are in the saved visit only.
        return {"command": AGAIN, "python": REPLAY}
    reach = "" if visit.reach is None else f" --reach {visit.reach!r}"
    line = _inspect(register) if is_judged(visit) else register
    return {"command": f"{line}{reach} --report report.html", "python": REPLAY}


def is_judged(visit: Visit) -> bool:
    """Whether there is a tolerance, and so a plan."""
    return visit.tolerance is not None or bool(visit.faces)


def _inspect(register: str) -> str:
    return f"{register.replace('dqreg register', 'dqreg inspect', 1)} --plan {PLAN}"


def _begun(visit: Visit, register: str, call: str) -> dict[str, dict[str, str]]:
    """The first three steps."""
    assert visit.scan is not None
    assert visit.part is not None
    scan, part = visit.scan.name, visit.part.name
    return {
        "load": {
            "command": f"dqreg studio {_words(scan, part)}",
            "python": f"{READ}scan = read_geometry({scan!r})\npart = read_geometry({part!r})",
        },
        "clean": {
            "command": AGAIN if visit.cuts else NOTHING,
            "python": REPLAY if visit.cuts else NOTHING,
        },
        "align": {
            "command": f"{register} --out result.json",
            "python": f"import dqreg\n\n{call}\nprint(result.verdict)",
        },
    }


def _register(visit: Visit) -> tuple[str, str]:
    assert visit.scan is not None
    assert visit.part is not None
    scan = CLEANED if visit.cuts else visit.scan.name
    line, call = f"dqreg register {_words(scan, visit.part.name)}", [repr(scan), repr(visit.part.name)]
    head = ""
    if visit.start == "identity":
        line, call = f"{line} --start identity", [*call, '"identity"']
    elif visit.start != "none":
        line, call = f"{line} --start {START}", [*call, "start"]
        head = f'import numpy as np\n\nstart = np.loadtxt("{START}")\n'
    for option, side in (("source", visit.scan), ("target", visit.part)):
        if side.units is not None:
            line, call = f"{line} --{option}-units {side.units}", [*call, f"{option}_units={side.units!r}"]
    if visit.start == "rival":
        line, call = f"{line} --search never", [*call, 'search="never"']
    if visit.dof and visit.start != "none":
        line, call = f'{line} --dof "{visit.dof}"', [*call, f"dof={visit.dof!r}"]
    return line, f"{head}result = dqreg.register({', '.join(call)})"


def _words(*names: str) -> str:
    return " ".join(shlex.quote(name) for name in names)


def plan_text(visit: Visit) -> str:
    """The visit as an inspection plan in TOML: tolerances, the alignment they are judged under, sections, head."""
    lines = ["# Faces are those of `dqreg faces`."]
    if visit.part is not None and visit.part.units is not None:
        lines.append(f'units = "{visit.part.units}"')
    if visit.tolerance is not None:
        lines += [_sides(visit.tolerance, visit.minus), f"required = {visit.required!r}"]
    lines += ["", *_alignment(visit)]
    if visit.head:
        lines += ["[head]", *(f"{key} = {_text(words)}" for key, words in visit.head), ""]
    for row in visit.faces:
        lines += ["[[face]]", f"face = {row.face}", _sides(row.tolerance, row.minus), ""]
    for k, each in enumerate(visit.sections, 1):
        lines += ["[[section]]", f'name = "section {k}"', f"point = {[*each.point]}", f"normal = {[*each.normal]}", ""]
    return "\n".join(lines)


def _alignment(visit: Visit) -> list[str]:
    """What the judgement rests on: nothing for the best fit on the whole part."""
    if visit.alignment == "best-fit":
        return []
    if visit.alignment == "datums":
        named = zip(LETTERS, visit.datums, strict=False)
        return [f'[[datum]]\nname = "{letter}"\nface = {face}\n' for letter, face in named]
    lines = ["[[alignment]]", f'name = "{ALIGNED[visit.alignment]}"']
    if visit.alignment == "points":
        points = [[*each.point, *each.normal] for each in visit.references]
        return [*lines, 'kind = "points"', f"points = {points}", ""]
    weights = [*visit.weights, *(1.0 for _ in visit.chosen)][: len(visit.chosen)]
    lines += [f'kind = "{visit.goal}"', f"faces = {[*visit.chosen]}", f"weights = {weights}"]
    if visit.goal == "tolerance" and visit.tolerance is not None:
        lines.append(_sides(visit.tolerance, visit.minus))
    return [*lines, ""]


def _sides(plus: float, minus: float | None) -> str:
    return f"tolerance = {plus!r}" if minus is None else f"plus = {plus!r}\nminus = {minus!r}"


def _text(words: str) -> str:
    # A basic string of TOML takes the escapes of JSON.
    return json.dumps(words)
