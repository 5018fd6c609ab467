"""Damaged files: a good one with bytes, numbers, lines, values or members of it changed; the same for the same draw."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
import zlib
from typing import Any

import numpy as np

NUMBERS = ("nan", "inf", "-inf", "-1", "0", "1e308", "-1e308", "1e400", "4294967296", "9" * 30, "1" * 400, "", "x",
           "1e-320", "true", "null", "[]", '"1"', "0x10", "1,5", "٣")  # fmt: skip
VALUES: tuple[Any, ...] = (None, "", "x", "1.0", -1, 0, 3.5, 1e308, 10**400, True, [], {}, [1, 2], [[1]], {"a": 1},
                           float("nan"), float("inf"), "a" * 1000, "\0", "\udcff")  # fmt: skip
BYTES = (0, 1, 9, 10, 13, 32, 34, 44, 45, 46, 58, 91, 127, 128, 254, 255)
TOKEN = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def mutated(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """A file with one to four changes, in its own structure where it has one."""
    for _ in range(int(rng.integers(1, 5))):
        content = _in_structure(content, others, rng) if rng.random() < 0.6 else _in_bytes(content, others, rng)
    return content


def _in_structure(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    try:
        if content.startswith(b"PK"):
            return _in_member(content, others, rng)
        if content.startswith(b"glTF"):
            return _in_glb(content, rng)
        if content.startswith((b"{", b"[")):
            return _in_tree(content, rng)
    except (ValueError, LookupError, OSError, EOFError, RuntimeError, struct.error, zlib.error, zipfile.BadZipFile):
        pass  # earlier changes have left no structure
    return _in_numbers(content, rng)


def _in_bytes(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    size = len(content)
    first = int(rng.integers(0, size + 1))
    last = min(size, first + int(rng.choice([1, 2, 4, 8, 64, 1000])))
    other = others[int(rng.integers(len(others)))]
    match int(rng.integers(0, 7)):
        case 0:
            return content[:first]
        case 1:
            return content[:first] + content[last:]
        case 2:
            return content[:last] + content[first:]
        case 3:
            return content[:first] + rng.integers(0, 256, last - first).astype(np.uint8).tobytes() + content[last:]
        case 4:
            return content[:first] + bytes([BYTES[int(rng.integers(len(BYTES)))]]) + content[first + 1 :]
        case 5:
            return content[:first] + other[int(rng.integers(0, len(other) + 1)) :]
        case _:
            lines = content.split(b"\n")
            k, m = rng.integers(0, len(lines), 2)
            lines[k] = lines[m]
            return b"\n".join(lines)


def _in_numbers(content: bytes, rng: np.random.Generator) -> bytes:
    found = list(TOKEN.finditer(content[:100_000]))
    if not found:
        return _in_bytes(content, [content], rng)
    place = found[int(rng.integers(len(found)))]
    return content[: place.start()] + NUMBERS[int(rng.integers(len(NUMBERS)))].encode() + content[place.end() :]


def _in_tree(content: bytes, rng: np.random.Generator) -> bytes:
    tree = json.loads(content)
    holder, key, value = None, None, tree
    while isinstance(value, (dict, list)) and value and rng.random() < 0.85:
        keys = list(value) if isinstance(value, dict) else range(len(value))
        holder, key = value, keys[int(rng.integers(len(keys)))]
        value = value[key]
    new = VALUES[int(rng.integers(len(VALUES)))]
    if holder is None:
        tree = new
    elif rng.random() < 0.2:
        del holder[key]
    else:
        holder[key] = new
    return json.dumps(tree).encode()


def _in_member(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(info, archive.read(info)) for info in archive.infolist()]
    which = int(rng.integers(len(members)))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        for k, (info, data) in enumerate(members):
            if k == which and rng.random() < 0.1:
                continue
            fresh = zipfile.ZipInfo(info.filename)
            fresh.compress_type = zipfile.ZIP_DEFLATED
            made.writestr(fresh, mutated(data, [data, *others], rng) if k == which else data)
    return stream.getvalue()


def _in_glb(content: bytes, rng: np.random.Generator) -> bytes:
    (length,) = struct.unpack_from("<I", content, 12)
    tree = _in_tree(content[20 : 20 + length].rstrip(), rng)
    tree += b" " * (-len(tree) % 4)
    rest = content[20 + length :]
    chunks = struct.pack("<I", len(tree)) + b"JSON" + tree + rest
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks
