"""Check of the structure of a MATLAB file (version 5 to 7) before SciPy reads it.

SciPy's reader trusts the sizes in the file, and a damaged one can end the process. (MathWorks,
MAT-File Format, R2024b, chapter 1.)
"""

import math
import struct
import zlib
from typing import NamedTuple

from ..._foundation.checks import InputError

HEADER = 128  # bytes
MATRIX, COMPRESSED = 14, 15
INT8, INT32, UINT32 = 1, 5, 6
# Bytes of one number by type of an element.
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
CELL, STRUCT, OBJECT, CHAR = 1, 2, 3, 4
NUMERIC = range(6, 16)
COMPLEX = 0x0800
DEEPEST = 20  # chosen: matrices inside of cells and structures


class Element(NamedTuple):
    """One element of a file: its type, and where its data stand."""

    type: int
    start: int
    size: int


class _DamageError(Exception):
    """A file is not structured as a MATLAB file."""


def require_intact(content: bytes, name: str) -> None:
    """Refuse a file of version 5 to 7 whose sizes and types do not fit each other.

    Args:
        content: the bytes of the file; other versions pass.
        name: name of the file.

    Raises:
        InputError: with the first place that does not fit.
    """
    if len(content) < HEADER or 0 in content[:4]:
        return  # version 4, or no MATLAB file
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128], "")
    if not order or content[125 if order == "<" else 124] != 1:
        return
    try:
        _check_file(content, order)
    except (_DamageError, struct.error, zlib.error) as error:
        raise InputError(
            f"{name} is damaged: {error}. Export it again, or read it as CSV."
        ) from error


def _check_file(content: bytes, order: str) -> None:
    at = HEADER
    while at < len(content):
        kind, size = _tag(content, at, order)
        _demand(kind in (MATRIX, COMPRESSED), f"type {kind} at byte {at}")
        _demand(at + 8 + size <= len(content), f"an element beyond the end at byte {at}")
        inner = content[at + 8 : at + 8 + size]
        _check_matrix(_unpacked(inner, order) if kind == COMPRESSED else inner, order, 0)
        at += 8 + size


def _unpacked(compressed: bytes, order: str) -> bytes:
    """Return the data of a compressed matrix."""
    inner = zlib.decompress(compressed)
    kind, size = _tag(inner, 0, order)
    _demand(kind == MATRIX and 8 + size <= len(inner), "no matrix in a compressed element")
    return inner[8 : 8 + size]


def _tag(data: bytes, at: int, order: str) -> tuple[int, int]:
    """Return type and size of an element with a tag of eight bytes."""
    return struct.unpack_from(f"{order}II", data, at)


def _elements(data: bytes, order: str) -> list[Element]:
    """Return the elements in the data of a matrix."""
    elements, at = [], 0
    while at < len(data):
        kind, size = _tag(data, at, order)
        if kind >> 16:  # a small element: size, type and up to four bytes of data in eight bytes
            size, kind = kind >> 16, kind & 0xFFFF
            _demand(size <= 4, "a small element of more than four bytes")
            elements.append(Element(kind, at + 4, size))
            at += 8
        else:
            elements.append(Element(kind, at + 8, size))
            at += 8 + size + (-size % 8)
        _demand(kind in SIZES or kind == MATRIX, f"an element of type {kind}")
        _demand(elements[-1].start + size <= len(data), "an element beyond its matrix")
    return elements


def _check_matrix(data: bytes, order: str, depth: int) -> None:
    """Refuse a matrix whose parts do not fit its class and its dimensions."""
    if not data:
        return  # an empty member of a cell or structure
    _demand(depth < DEEPEST, f"more than {DEEPEST} matrices in each other")
    parts = _elements(data, order)
    _demand(len(parts) >= 3, "a matrix without flags, dimensions or name")
    flags, dimensions, name, *rest = parts
    _demand(flags.type == UINT32 and flags.size == 8, "flags of another type")
    _demand(dimensions.type == INT32 and dimensions.size >= 8, "dimensions of another type")
    _demand(dimensions.size % 4 == 0, "dimensions that are no whole numbers")
    _demand(name.type == INT8, "a name of another type")
    (bits,) = struct.unpack_from(f"{order}I", data, flags.start)
    shape = struct.unpack_from(f"{order}{dimensions.size // 4}i", data, dimensions.start)
    _demand(min(shape) >= 0, "a negative dimension")
    _check_members(data, order, bits, math.prod(shape), rest, depth)


def _check_members(
    data: bytes, order: str, bits: int, count: int, rest: list[Element], depth: int
) -> None:
    """Refuse numbers or members that are not as many as the dimensions require."""
    kind = bits & 0xFF
    if kind in NUMERIC:
        _demand(len(rest) == (2 if bits & COMPLEX else 1), "numbers of another count of parts")
        fits = all(part.size == count * SIZES.get(part.type, 0) for part in rest)
        _demand(fits, "numbers of another count")
    elif kind in (CELL, STRUCT, OBJECT):
        members = [part for part in rest if part.type == MATRIX]
        for part in members:
            _check_matrix(data[part.start : part.start + part.size], order, depth + 1)
        if kind == CELL:
            _demand(len(members) == count == len(rest), "cells of another count")
        else:
            _demand(_has_fields(data, order, rest, len(members), count), "fields")
    else:
        _demand(kind == CHAR, f"an array of class {kind}, which is not read")
        _demand(len(rest) == 1 or count == 0, "a text without characters")
        fits = all(part.size <= 4 * count and part.type in SIZES for part in rest)
        _demand(fits, "characters of another count")


def _has_fields(data: bytes, order: str, rest: list[Element], members: int, count: int) -> bool:
    """Return True if a structure has the names of its fields, and a member for each."""
    names = [part for part in rest if part.type != MATRIX]
    if len(names) < 2 or names[-2].type != INT32 or names[-2].size != 4:
        return False
    (length,) = struct.unpack_from(f"{order}i", data, names[-2].start)
    if length <= 0 or names[-1].type != INT8 or names[-1].size % length:
        return False
    return members == count * (names[-1].size // length)


def _demand(condition: bool, damage: str) -> None:
    if not condition:
        raise _DamageError(damage)
