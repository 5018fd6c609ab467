"""The same without the page: for each step the command line and the Python that do what was chosen."""

from __future__ import annotations

import shlex
from pathlib import PurePath

from dqreg.studio.plans import is_judged
from dqreg.studio.visit import PLAN, START, Visit

READ = "from dqreg.files import read_geometry\n\n"
AGAIN = "dqreg studio --replay visit.json --out ."
REPLAY = "from dqreg.studio import replay\n\nreplay('visit.json', '.')"
NOTHING = "# nothing is left out"


def cleaned_name(visit: Visit) -> str | None:
    """File of what the cuts leave of a scan, or of its mirror image; None where the file itself is registered.

    >>> from dqreg.studio.visit import Cut, Side
    >>> cleaned_name(Visit(Side("a.pcd", "a.pcd"), cuts=(Cut("box"),)))
    'a_cleaned.ply'
    """
    if visit.scan is None or not (visit.cuts or visit.mirrored):
        return None
    return f"{PurePath(visit.scan.name).stem}_cleaned.ply"


def commands_of(visit: Visit) -> dict[str, dict[str, str]]:
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
            "command": AGAIN if cleaned_name(visit) else NOTHING,
            "python": REPLAY if cleaned_name(visit) else NOTHING,
        },
        "align": {
            "command": f"{register} --out result.json",
            "python": f"import dqreg\n\n{call}\nprint(result.verdict)",
        },
    }


def _register(visit: Visit) -> tuple[str, str]:
    assert visit.scan is not None
    assert visit.part is not None
    scan = cleaned_name(visit) or visit.scan.name
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
    # A name that begins like an option is a file all the same.
    return " ".join(shlex.quote(f"./{name}" if name.startswith("-") else name) for name in names)
