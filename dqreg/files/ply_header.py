"""The header of a PLY file: what it promises, and whether the file is long enough to keep the promise."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.units import unit_of_comment
from dqreg.files.untrusted import LONGEST_HEADER, unreadable

# NumPy codes of the PLY types, under their old and new names.
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
# The format has no place for where the sensor stood: "viewpoint 0.5 -1 2", and nothing else in the comment.
VIEWPOINT = re.compile(r"viewpoint((?:\s+[-+.\deE]+){3})", re.IGNORECASE)
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclasses.dataclass(frozen=True)
class Property:
    """One column of an element: a number, or (with ``count_type``) a list led by its length."""

    name: str
    type: str
    count_type: str | None = None


@dataclasses.dataclass(frozen=True)
class Element:
    """A table in the file: its name, number of rows and columns."""

    name: str
    count: int
    properties: tuple[Property, ...] = ()

    @property
    def has_lists(self) -> bool:
        """Whether rows may differ in length."""
        return any(column.count_type for column in self.properties)

    @property
    def least_row_bytes(self) -> int:
        """Bytes of a binary row with all lists empty; exact where there are no lists."""
        return sum(int((column.count_type or column.type)[1]) for column in self.properties)


@dataclasses.dataclass(frozen=True)
class PlyHeader:
    """What a PLY header says."""

    byte_order: str  # ``"<"`` or ``">"``; empty for text
    elements: tuple[Element, ...]  # The tables in the order of the file
    size: int  # Bytes of the header: where the tables begin
    units: str | None = None  # Length unit, where a comment states one ("comment units mm") and no other contradicts it
    viewpoint: FloatArray | None = None  # (3,): Where the sensor stood, where a comment says so and no other does

    def element(self, name: str) -> Element | None:
        """Table of this name, or None."""
        return next((element for element in self.elements if element.name == name), None)

    @property
    def least_bytes(self) -> int:
        """Bytes that the tables need at the very least."""
        if self.byte_order:
            return sum(element.count * element.least_row_bytes for element in self.elements)
        # In text a number takes a digit and a space or line end, which only the very last number may lack.
        return max(0, sum(2 * element.count * len(element.properties) for element in self.elements) - 1)


def read_header(path: Path) -> PlyHeader:
    """Header of a PLY file, found to be consistent with the size of the file."""
    with path.open("rb") as stream:
        head = stream.read(LONGEST_HEADER)
    if head[:3] != b"ply" or head[3:4] not in (b"\n", b"\r"):
        raise unreadable(path, f"a file that begins with {head[:12]!r}", "a PLY file; it begins with ply")
    newline = b"\r\n" if head[3:5] == b"\r\n" else head[3:4]
    text, end, _ = head.partition(newline + b"end_header" + newline)
    if not end:
        raise unreadable(path, "a PLY header without its end_header line", "a whole file; was it cut short?")
    lines = text.decode("ascii", errors="replace").split(newline.decode())
    header = _parse(path, lines[1:], len(text) + len(end))
    rest = path.stat().st_size - header.size
    if rest < header.least_bytes:
        promise = ", ".join(f"{element.count} {element.name} rows" for element in header.elements)
        raise unreadable(
            path,
            f"a header that promises {promise} but only {rest} bytes of them",
            f"at least {header.least_bytes} bytes; was the file cut short?",
        )
    return header


def _parse(path: Path, lines: list[str], size: int) -> PlyHeader:
    order: str | None = None
    elements: list[Element] = []
    comments: list[str] = []
    for line in lines:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            comments.append(" ".join(words[1:]))
            continue
        try:
            if words[0] == "format":
                order = BYTE_ORDERS[words[1]]
            elif words[0] == "element":
                elements.append(Element(words[1], _count(words[2])))
            elif words[0] == "property":
                table = elements[-1]
                elements[-1] = dataclasses.replace(table, properties=(*table.properties, _property(words)))
            else:
                raise ValueError(words[0])
        except (KeyError, IndexError, ValueError) as error:
            raise unreadable(path, f"the header line {line.strip()!r}", "a line of the PLY format") from error
    if order is None:
        raise unreadable(path, "a PLY header without a format line", "format ascii or binary")
    units = {*map(unit_of_comment, comments)} - {None}
    places = {*map(viewpoint_of_comment, comments)} - {None}
    place = np.array(places.pop(), dtype=np.float64) if len(places) == 1 else None
    return PlyHeader(order, tuple(elements), size, units.pop() if len(units) == 1 else None, place)


def comments_of(units: str | None, viewpoint: FloatArray | None) -> list[str]:
    """Comments by which a file tells its length unit and where the sensor stood.

    >>> comments_of("mm", np.array([0.1, 2.0, -3e-7]))
    ['units mm', 'viewpoint 0.1 2.0 -3e-07']
    """
    found = [] if units is None else [f"units {units}"]
    return found if viewpoint is None else [*found, f"viewpoint {' '.join(map(repr, viewpoint.tolist()))}"]


def viewpoint_of_comment(comment: str) -> tuple[float, ...] | None:
    """Place of a sensor that a comment states and nothing else, or None."""
    stated = VIEWPOINT.fullmatch(comment.strip())
    try:
        place = tuple(map(float, stated.group(1).split())) if stated else ()
    except ValueError:
        return None
    return place if place and np.isfinite(place).all() else None


def _property(words: list[str]) -> Property:
    if words[1] != "list":
        return Property(name=words[2], type=TYPES[words[1]])
    count_type = TYPES[words[2]]
    if count_type[0] == "f":
        raise ValueError("a list's length must be an integer")
    return Property(name=words[4], type=TYPES[words[3]], count_type=count_type)


def _count(word: str) -> int:
    if not word.isdecimal():
        raise ValueError(f"{word} is no count")
    return int(word)
