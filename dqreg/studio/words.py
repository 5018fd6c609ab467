"""The same without the page: for each step the command line and the Python that do what was chosen, and the plan."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence

from dqreg.studio.visit import Visit

CLEANED, START, PLAN = "scan_cleaned.ply", "start.txt", "plan.toml"
LETTERS = "ABC"
READ = "from dqreg.files import read_geometry\n\n"
AGAIN = "dqreg studio --replay visit.json --out ."
REPLAY = "from dqreg.studio import replay\n\nreplay('visit.json', '.')"
NOTHING = "# nothing is left out"


def words_of(visit: Visit) -> dict[str, dict[str, str]]:
    """Command and Python of every step, by its name; none where its files are missing."""
    if visit.scan is None or visit.part is None:
        return {}
    register, call = _register(visit)
    tolerance = "" if visit.tolerance is None else f" --tolerance {visit.tolerance:g} --required {visit.required:g}"
    reach = "" if visit.reach is None else f" --reach {visit.reach:g}"
    judged = f"{register}{tolerance}{reach}"
    limit = "" if visit.tolerance is None else f"{visit.tolerance!r}"
    asked = limit + ("" if visit.reach is None else f"{', ' if limit else ''}reach={visit.reach!r}")
    measured = f"{call}\ndeviations = result.deviations({asked})\nprint(deviations.summary())"
    if visit.tolerance is not None:
        measured += f"\nprint(dqreg.inspection.decide(deviations, required_share={visit.required / 100.0!r}).outcome)"
    inspected = _inspect(visit)
    unsaid = inspected and (visit.reach is not None or visit.dof or visit.start == "rival")
    if visit.alignment in ("faces", "points") or unsaid:
        # No option of a command says which faces or points were clicked, and `inspect` has fewer than `register`: the
        # saved visit says it all.
        return _begun(visit, register, call) | {
            step: {"command": AGAIN, "python": REPLAY} for step in ("judge", "report")
        }
    if inspected:
        measured += f'\nplan = dqreg.inspection.read_plan("{PLAN}")\nprint(dqreg.inspection.inspect(deviations, plan))'
    head = "import dqreg\nimport dqreg.inspection\n\n"
    report = f'{call}\nresult.report("report.html"{f", {limit}" if limit else ""})'
    return _begun(visit, register, call) | {
        "judge": {"command": inspected or judged, "python": head + measured},
        # A report with a plan and an overall tolerance is one that no single command writes.
        "report": {
            "command": AGAIN if inspected else f"{judged} --report report.html",
            "python": REPLAY if inspected else f"import dqreg\n\n{report}",
        },
    }


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


def _inspect(visit: Visit) -> str:
    if not visit.faces and visit.alignment != "datums":
        return ""
    assert visit.scan is not None
    assert visit.part is not None
    scan = CLEANED if visit.cuts else visit.scan.name
    start = {"none": "", "identity": " --start identity"}.get(visit.start, f" --start {START}")
    units = "".join(
        f" --{name}-units {side.units}"
        for name, side in (("source", visit.scan), ("target", visit.part))
        if side.units is not None
    )
    return f"dqreg inspect {_words(scan, visit.part.name)} --plan {PLAN}{start}{units}"


def _words(*names: str) -> str:
    return " ".join(shlex.quote(name) for name in names)


def plan_text(visit: Visit, scanned: Sequence[int] = ()) -> str | None:
    """The visit as an inspection plan in TOML; None where it has no tolerance for any face.

    Faces with a tolerance of their own have that; the others that were scanned have the overall one.
    """
    own = {row.face: row.tolerance for row in visit.faces}
    overall = {} if visit.tolerance is None else dict.fromkeys(sorted(scanned), visit.tolerance)
    rows = [_profile(face, tolerance) for face, tolerance in {**overall, **own}.items()]
    if not rows:
        return None
    datums = visit.datums if visit.alignment == "datums" else ()
    lines = ["# Faces are those of `dqreg faces`."]
    if visit.alignment in ("faces", "points"):
        lines.append("# The visit rests on chosen faces or points, which no plan can say: dqreg studio --replay does.")
    if visit.part is not None and visit.part.units is not None:
        lines.append(f'units = "{visit.part.units}"')
    lines.append(f'alignment = "{"datums" if datums else "best-fit"}"\n')
    if visit.head:
        lines += ["[head]", *(f"{key} = {_text(words)}" for key, words in visit.head), ""]
    for letter, face in zip(LETTERS, datums, strict=False):
        lines.append(f'[[datum]]\nname = "{letter}"\nface = {face}\n')
    return "\n".join([*lines, *rows])


def _profile(face: int, tolerance: float) -> str:
    # The zone of a profile is as wide as both sides of the tolerance together.
    head = f'[[characteristic]]\nname = "face {face} profile"\nkind = "profile"\n'
    return f"{head}face = {face}\ntolerance = {2.0 * tolerance!r}\n"


def _text(words: str) -> str:
    # A basic string of TOML takes the escapes of JSON.
    return json.dumps(words)
