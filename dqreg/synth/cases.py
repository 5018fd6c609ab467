"""A case: a folder with a scan, the part, the truth and the recipe that made them."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg._records import one_line
from dqreg.errors import InputError
from dqreg.files.json_records import read_json
from dqreg.synth.case_contents import PART, RECIPE, SCAN, TRUTH, case_contents
from dqreg.synth.recipe import Recipe, read_recipe

# Of cases that no recipe made: a scan's target may be another scan.
PART_PLY = "part.ply"


@dataclass(frozen=True, eq=False)
class Case:
    """What is known of a case; the scan and the part are read by whoever needs them.

    Attributes
    ----------
    folder : Path
        The case's folder.
    scan, part, recipe : Path
        ``scan.ply`` (the source), ``part.stl`` (the target) and ``recipe.toml`` in it. A case of one's own may have a
        cloud or a mesh ``part.ply`` instead, and no recipe.
    T_target_source : ndarray, (4, 4)
        Truth: maps the scan's coordinates to the part's.
    T_start : ndarray, (4, 4)
        Initial pose, of the same kind, a known disturbance away from the truth.
    units : str
        Unit of every length: "mm", "cm", "m" or "in".
    part_diagonal : float
        Diagonal S of the part's bounding box.
    range_sigma : float
        Standard deviation of the range noise, as a length.
    seed : int
        Seed with which the case was made.
    symmetric_truths : ndarray, (k, 4, 4)
        Every pose that puts the scan on the part as well, the truth first; a round part may be turned besides, see
        ``truth["symmetry_axis"]``. The truth alone where no others are known.
    truth : mapping
        All of ``truth.json``.
    """

    __repr__ = one_line
    folder: Path
    scan: Path
    part: Path
    recipe: Path
    T_target_source: FloatArray
    T_start: FloatArray
    units: str
    part_diagonal: float
    range_sigma: float
    seed: int
    symmetric_truths: FloatArray
    truth: Mapping[str, Any]


def load_case(folder: str | os.PathLike[str]) -> Case:
    """Read what is known of a case: its ``truth.json``.

    Parameters
    ----------
    folder : str or path
        Folder of the case.

    Returns
    -------
    Case
        Paths and poses.

    Raises
    ------
    InputError
        If a file is missing, or ``truth.json`` does not hold what it must; the message names it.

    Examples
    --------
    >>> case = load_case(demo_case())
    >>> case.T_target_source.shape, case.units
    ((4, 4), 'mm')
    """
    folder = Path(folder)
    part = folder / (PART_PLY if (folder / PART_PLY).is_file() else PART)
    for path in (folder / SCAN, part, folder / TRUTH):
        if not path.is_file():
            needed = f"{SCAN}, {PART} or {PART_PLY}, {TRUTH}"
            raise InputError(f"{folder} is not a case: {path.name} is missing; needed: {needed}")
    try:
        truth = read_json(folder / TRUTH, "the truth of a case")
        return Case(
            folder=folder,
            scan=folder / SCAN,
            part=part,
            recipe=folder / RECIPE,
            T_target_source=as_pose(truth["T_target_source"], "T_target_source"),
            T_start=as_pose(truth["T_start"], "T_start"),
            units=str(truth["units"]),
            part_diagonal=float(truth["part_diagonal"]),
            range_sigma=float(truth["range_sigma"]),
            seed=int(truth["seed"]),
            symmetric_truths=_poses(truth.get("symmetric_truths") or [truth["T_target_source"]]),
            truth=truth,
        )
    except KeyError as error:
        raise InputError(f"{folder / TRUTH}: the key {error} is missing") from error
    except (TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise InputError(f"{folder / TRUTH}: {error}") from error


def write_case(
    folder: str | os.PathLike[str], recipe: Recipe | str | os.PathLike[str], *, seed: int | None = None
) -> Case:
    r"""Make a case from a recipe: all of its folder, or nothing.

    Parameters
    ----------
    folder : str or path
        Folder to make. An older case in it is replaced; a folder with other things in it is left alone.
    recipe : Recipe, str or path
        The recipe, or its TOML file.
    seed : int, optional
        Use this seed instead of the recipe's.

    Returns
    -------
    Case
        The case as written.

    Raises
    ------
    InputError
        If the recipe is wrong (the message names the key), or the folder cannot be written.
    DegenerateGeometryError
        If the views leave a direction of motion undetermined.
    MissingDependencyError
        If Open3D cannot be loaded.

    Notes
    -----
    The same recipe and seed give the same bytes on one kind of processor and library version, and the same
    case to rounding elsewhere.

    Examples
    --------
    >>> import tempfile
    >>> from dqreg.synth.recipe import parse_recipe
    >>> recipe = parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\npixels = 30\nviews = [[1, 2, 3]]\n')
    >>> with tempfile.TemporaryDirectory() as temporary:
    ...     write_case(Path(temporary) / "box", recipe).truth["faces"]
    12
    """
    folder = Path(folder).resolve()  # "." has no name that can be moved, and a link would lose its target
    require_replaceable(folder, (SCAN, PART, TRUTH, RECIPE))
    recipe = recipe if isinstance(recipe, Recipe) else read_recipe(recipe)
    recipe = recipe if seed is None else recipe.with_seed(seed)
    write_folder(folder, case_contents(recipe))
    return load_case(folder)


def demo_case() -> Path:
    """Find the case that ships with the package: a bracket in millimetres.

    Returns
    -------
    Path
        Its folder, in the installed package or in a checkout.

    Raises
    ------
    InputError
        If it is in neither place.

    Examples
    --------
    >>> demo_case().name
    'bracket'
    """
    here = Path(__file__).resolve()
    places = here.parent / "bracket", here.parents[2] / "datasets_synth" / "bracket"
    for place in places:
        if (place / TRUTH).is_file():
            return place
    raise InputError(
        f"the demonstration case is missing: neither {places[0]} nor {places[1]} holds {TRUTH}; "
        "install the package again: pip install --force-reinstall dqreg"
    )


def _poses(rows: Any) -> FloatArray:
    return np.stack([as_pose(T, f"symmetric_truths[{k}]") for k, T in enumerate(rows)])


def require_replaceable(folder: Path, names: tuple[str, ...]) -> None:
    """Raise unless a folder is new, empty, or holds an older case of these files alone."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"cannot write the case {folder}: it is a file; give the name of a folder")
    if folder.is_dir() and any(folder.iterdir()):
        foreign = sorted({p.name for p in folder.iterdir()} - set(names))
        if foreign:
            raise InputError(f"cannot write the case {folder}: it holds {foreign[0]!r}; give a new folder")


def write_folder(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write the files of a case, by their paths in its folder: all of them, or nothing."""
    partial = folder.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        for name, content in contents.items():
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            (partial / name).write_bytes(content)
        _put_in_place(partial, folder)
    except OSError as error:
        raise InputError(f"cannot write the case {folder}: {error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _put_in_place(partial: Path, folder: Path) -> None:
    """Give a finished folder its name; an older case is moved aside and restored if that fails."""
    if not folder.exists():
        partial.rename(folder)
        return
    aside = folder.with_name(f".{secrets.token_hex(8)}.old")
    folder.rename(aside)
    try:
        partial.rename(folder)
    except OSError:
        aside.rename(folder)
        raise
    shutil.rmtree(aside, ignore_errors=True)
