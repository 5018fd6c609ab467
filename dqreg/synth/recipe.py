"""A recipe: the text file from which a case is made, read with care."""

from __future__ import annotations

import dataclasses
import os
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.synth import parts
from dqreg.synth.noise import Noise
from dqreg.synth.raycast import check_mesh
from dqreg.synth.recipe_keys import build, check_seed, get_number, get_table, get_text, require_known
from dqreg.synth.views import Scanner

PARTS: dict[str, Callable[..., parts.Mesh]] = {
    "box": parts.box,
    "bracket": parts.bracket,
    "cylinder": parts.cylinder,
    "plate": parts.plate,
}
UNITS = ("mm", "cm", "m", "in")

_TOP = ("name", "seed", "units", "coordinates", "part", "scanner", "noise", "frame", "start")


@dataclass(frozen=True, eq=False)
class Recipe:
    """What makes a case; `read_recipe` gives one.

    Attributes
    ----------
    name : str
        Name of the case.
    seed : int
        Seed of all randomness.
    units : str
        Unit of every length: "mm", "cm", "m" or "in".
    coordinates : str
        How the scan's coordinates are stored: "float64" or "float32".
    part : mapping
        Keys of the table ``[part]``: ``kind`` and its dimensions, or ``file``.
    scanner : Scanner
        Views of the part.
    noise : Noise
        What goes wrong.
    frame_offset : float
        How far the part's centre is moved when the scan gets its own frame, in diagonals of the part.
    start_angle_rad : float
        Turn between the start pose and the truth.
    start_offset : float
        Shift of the part's centre between the start pose and the truth, in diagonals of the part.
    text : str
        The recipe as it was written.
    folder : Path
        Folder from which ``file`` is looked up.
    """

    name: str
    seed: int
    units: str
    coordinates: str
    part: Mapping[str, Any]
    scanner: Scanner
    noise: Noise
    frame_offset: float
    start_angle_rad: float
    start_offset: float
    text: str
    folder: Path

    def with_seed(self, seed: int) -> Recipe:
        r"""Return the same recipe with another seed, also in its text.

        Parameters
        ----------
        seed : int
            The new seed, not negative.

        Returns
        -------
        Recipe
            A new recipe.

        Raises
        ------
        InputError
            If the seed is not a whole number, or negative.

        Examples
        --------
        >>> recipe = parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n')
        >>> recipe.with_seed(7).text.splitlines()[0]
        'seed = 7'
        """
        text = re.sub(r"(?m)\A((?:(?!\[).*\n)*?)seed\s*=\s*\d+", rf"\g<1>seed = {seed}", self.text)
        return dataclasses.replace(self, seed=check_seed(seed), text=text)

    def mesh(self) -> parts.Mesh:
        r"""Build or read the part, rounded to float32 as an STL file holds it.

        Returns
        -------
        vertices : ndarray, (v, 3)
            Float64 numbers that float32 can hold.
        faces : ndarray, (f, 3)
            Int64.

        Raises
        ------
        InputError
            If the part's dimensions do not fit, or the file cannot be read; the message names it.

        Examples
        --------
        >>> recipe = parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n')
        >>> recipe.mesh()[1].shape
        (12, 3)
        """
        if "file" in self.part:
            vertices, faces = _read_mesh(self.folder / self.part["file"])
        else:
            dimensions = {key: value for key, value in self.part.items() if key != "kind"}
            vertices, faces = build(PARTS[self.part["kind"]], "part", dimensions)
        return vertices.astype(np.float32).astype(np.float64), faces


def read_recipe(path: str | os.PathLike[str]) -> Recipe:
    r"""Read a recipe from a TOML file.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    Recipe
        All keys checked and defaults filled in.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or a key is missing, unknown or wrong; the message names the
        key.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "recipe.toml"
    ...     _ = path.write_text('seed = 1\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n')
    ...     read_recipe(path).part["kind"]
    'box'
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the recipe {path}: {error}") from error
    return parse_recipe(text, path.parent)


def parse_recipe(text: str, folder: str | os.PathLike[str] = ".") -> Recipe:
    r"""Read a recipe from TOML text.

    Parameters
    ----------
    text : str
        TOML.
    folder : str or path
        Folder from which ``part.file`` is looked up.

    Returns
    -------
    Recipe
        All keys checked and defaults filled in.

    Raises
    ------
    InputError
        If the text is not TOML, or a key is missing, unknown or wrong; the message names the key.

    Examples
    --------
    >>> parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n').units
    'mm'
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"the recipe is not TOML: {error}") from error
    require_known(data, _TOP, "")
    scanner, noise = get_table(data, "scanner", None), get_table(data, "noise", None)
    frame, start = get_table(data, "frame", ("offset",)), get_table(data, "start", ("angle_deg", "offset"))
    if "views" not in scanner:
        raise InputError("recipe: scanner.views is missing; give directions [x, y, z] from part to sensor")
    return Recipe(
        name=get_text(data, "name", "case"),
        seed=check_seed(data.get("seed")),
        units=get_text(data, "units", "mm", UNITS),
        coordinates=get_text(data, "coordinates", "float64", ("float64", "float32")),
        part=_part(get_table(data, "part", None)),
        scanner=build(Scanner, "scanner", scanner),
        noise=build(Noise, "noise", noise),
        frame_offset=get_number(frame, "frame.offset", 0.5),
        start_angle_rad=float(np.deg2rad(get_number(start, "start.angle_deg", 20.0))),
        start_offset=get_number(start, "start.offset", 0.05),
        text=text,
        folder=Path(folder),
    )


def _part(part: Mapping[str, Any]) -> Mapping[str, Any]:
    if "file" in part:
        require_known(part, ("file",), "part.")
        get_text(part, "part.file", "")
        return part
    if "kind" not in part:
        raise InputError(f"recipe: part.kind is missing; give one of {', '.join(PARTS)}, or part.file")
    get_text(part, "part.kind", "", PARTS)
    return part


def _read_mesh(path: Path) -> parts.Mesh:
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
        return check_mesh(mesh.vertices, mesh.faces)
    except Exception as error:  # trimesh raises whatever its readers raise
        raise InputError(f"recipe: part.file: cannot read a mesh from {path}: {error}") from error
