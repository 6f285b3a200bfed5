"""Lists that people keep beside their clips: CSV, JSON lines and plain lines, each mistake told with its line."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import msgspec

from motiongen.data.clip import SourceError


class _Caption(msgspec.Struct):
    file: str
    caption: str


def csv_rows(path: Path, columns: tuple[str, ...]) -> list[tuple[int, list[str]]]:
    """Line number and the values of `columns` of every row below the header; raises SourceError for a bad one."""
    reader = csv.reader(io.StringIO(text_of(path)))
    try:
        (_, header), *found = [(reader.line_num, row) for row in reader] or [(1, [])]
    except csv.Error as error:
        raise SourceError(f"{path}: line {reader.line_num}: {error}") from None
    if missing := [c for c in columns if c not in header]:
        raise SourceError(f"{path}: no column {missing[0]!r} in its first line; it needs {','.join(columns)}")
    for line, row in found:
        if len(row) != len(header):
            what = f"{len(row)} values instead of {len(header)}" if row else "blank"
            raise SourceError(f"{path}: line {line}: {what}")
    return [(line, [row[header.index(c)] for c in columns]) for line, row in found]


def jsonl_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Line number, file and caption of every line; raises SourceError for a bad one."""
    rows = []
    for number, line in enumerate(text_of(path).split("\n"), start=1):
        try:
            row = msgspec.json.decode(line, type=_Caption)
        except msgspec.DecodeError as error:
            what = str(error) if line.strip() else "blank"
            raise SourceError(f'{path}: line {number}: {what}; expected {{"file": …, "caption": …}}') from None
        rows.append((number, [row.file, row.caption]))
    return rows


def text_of(path: Path) -> str:
    """The file's text without blank lines at its end; raises SourceError where it is not UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig").rstrip("\n")
    except UnicodeDecodeError:
        raise SourceError(f"{path}: not UTF-8 text") from None
