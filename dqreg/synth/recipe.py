"""A recipe: the text file from which a case is made, read with care."""

from __future__ import annotations

import dataclasses
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqreg.errors import InputError
from dqreg.files.units import METRES
from dqreg.files.untrusted import read_record
from dqreg.synth import parts
from dqreg.synth.motion import Motion
from dqreg.synth.noise import Noise
from dqreg.synth.recipe_faults import KEYS as FAULTS
from dqreg.synth.recipe_faults import Fault, read_faults
from dqreg.synth.recipe_keys import build, check_name, check_seed, get_number, get_table, get_text, require_known
from dqreg.synth.recipe_tables import (
    AnyScanner,
    check_part,
    make_mesh,
    make_motion,
    make_noise,
    make_scanner,
    symmetry_of_part,
)
from dqreg.synth.scene import Scene

_TOP = (
    "name",
    "seed",
    "units",
    "coordinates",
    "part",
    "scene",
    "scanner",
    "noise",
    "motion",
    "frame",
    "start",
    *FAULTS,
)
# Farther than this, in diagonals of the part, an initial pose or a frame is a typing error.
_FAR_DIAGONALS = 1e6


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
        Unit of every length: "um", "mm", "cm", "m", "inch" or "ft".
    coordinates : str
        How the scan's coordinates are stored: "float64" or "float32".
    part : mapping
        Keys of the table ``[part]``: ``kind`` and its dimensions, or ``file``.
    scene : Scene
        What lies around the part.
    scanner_kind : str
        "camera", "structured_light", "lidar" or "tactile".
    scanner : Scanner, StructuredLight, Lidar or TactileProbe
        What scans the part.
    noise : Noise
        Error model.
    motion : Motion, optional
        How the part moves meanwhile; None at rest.
    faults : tuple of Fault
        Form errors and moved features of the part, from ``[[form_error]]`` and ``[[moved_feature]]``.
    frame_offset : float
        How far the part's centre is moved when the scan gets its own frame, in diagonals of the part.
    start_angle_rad : float
        Rotation between the initial pose and the truth.
    start_offset : float
        Translation of the part's centre between the initial pose and the truth, in diagonals of the part.
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
    scene: Scene
    scanner_kind: str
    scanner: AnyScanner
    noise: Noise
    motion: Motion | None
    frame_offset: float
    start_angle_rad: float
    start_offset: float
    text: str
    folder: Path
    faults: tuple[Fault, ...] = ()

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
        return make_mesh(self.part, self.folder)

    def streams(self) -> tuple[np.random.Generator, np.random.Generator, np.random.Generator]:
        r"""Return a generator each for the scan, the poses and the surroundings.

        More pixels so do not change the initial pose of the case.

        Returns
        -------
        tuple of 3 numpy.random.Generator
            New ones at every call, the same ones for the same seed.

        Examples
        --------
        >>> recipe = parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n')
        >>> len(recipe.streams())
        3
        """
        scan, poses, scene = np.random.default_rng(self.seed).spawn(3)
        return scan, poses, scene

    def symmetry(self) -> parts.Symmetry | None:
        r"""Find the motions that put the part onto itself.

        Returns
        -------
        Symmetry or None
            None for a part from a file: it is not searched for.

        Examples
        --------
        >>> recipe = parse_recipe('seed = 1\n[part]\nkind = "box"\n[scanner]\nviews = [[0, 0, 1]]\n')
        >>> len(recipe.symmetry().poses)
        24
        """
        return symmetry_of_part(self.part)


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
        If the file cannot be read, is not TOML, or a key is missing, unknown or wrong; the message names file and
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
    text = read_record(path, "a recipe (TOML)")
    try:
        return parse_recipe(text, path.parent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def parse_recipe(text: str, folder: str | os.PathLike[str] = ".") -> Recipe:
    """Recipe of TOML text, checked, defaults filled in; ``part.file`` is looked up from the folder."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"the recipe is not TOML: {error}") from error
    if "axis" in data:
        raise InputError("this is a sweep, not a recipe; did you mean dqreg compare --sweep FILE?")
    require_known(data, _TOP, "")
    frame, start = get_table(data, "frame", ("offset",)), get_table(data, "start", ("angle_deg", "offset"))
    kind, scanner = make_scanner(get_table(data, "scanner", None))
    scene = build(Scene, "scene", get_table(data, "scene", None))
    if kind == "tactile" and scene.kind != "none":
        raise InputError(f"recipe: scene.kind = {scene.kind!r} means nothing for a tactile probe; take [scene] out")
    return Recipe(
        name=check_name(data.get("name", "case")),
        seed=check_seed(data.get("seed")),
        units=get_text(data, "units", "mm", METRES),
        coordinates=get_text(data, "coordinates", "float64", ("float64", "float32")),
        part=check_part(get_table(data, "part", None)),
        scene=scene,
        scanner_kind=kind,
        scanner=scanner,
        noise=make_noise(get_table(data, "noise", None), kind),
        motion=make_motion(get_table(data, "motion", None), kind),
        frame_offset=get_number(frame, "frame.offset", 0.5, most=_FAR_DIAGONALS),
        start_angle_rad=float(np.deg2rad(get_number(start, "start.angle_deg", 20.0, most=180.0))),
        start_offset=get_number(start, "start.offset", 0.05, most=_FAR_DIAGONALS),
        text=text,
        folder=Path(folder),
        faults=read_faults(data, kind),
    )
