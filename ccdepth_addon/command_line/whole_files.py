# SPDX-License-Identifier: GPL-3.0-or-later
"""Files written as a whole or not at all.

On a full disk, Blender still reports that it has saved a file or written a picture, and has by then truncated the
earlier file. So files are written beside their place, checked to their end, and only then moved there.

The given name decides the format, and a link is replaced, not followed.
"""

from __future__ import annotations

import os
import shutil
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from errno import ENOLCK, ENOTSUP
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

PNG, PNG_SIGNATURE = ".png", b"\x89PNG\r\n\x1a\n"

# A .blend file that is compressed consists of Zstandard frames, and a table of them at its end.
ZSTANDARD_FRAME = b"\x28\xb5\x2f\xfd"
SEEK_TABLE = struct.Struct("<IBI")
SEEK_TABLE_MARK = 0x8F92EAB1
SEEK_TABLE_HEADER_SIZE = 8
HAS_CHECKSUMS = 0x80

# The least free space in bytes; with less, the next write does not fit.
LEAST_FREE = 1 << 16

# The headers of a .blend file's blocks: of files up to version 4 and since version 5.
BLOCK_HEADER = struct.Struct("<4siQii")
LARGE_BLOCK_HEADER = struct.Struct("<4siQqq")


class UnwrittenError(OSError):
    """The error of a file that could not be written as a whole; the earlier file is still there. The message says
    why."""


EXISTS = "it exists already; use --overwrite to replace it"


def refuse_existing(path: Path, overwrite: bool, companions: Sequence[str] = ()) -> None:
    """Raise UnwrittenError if something there has to stay: a file without ``overwrite``, a device or a folder always.

    companions: suffixes of files that belong to it, and are checked as well.
    """
    for each in (path, *(path.with_suffix(suffix) for suffix in companions)):
        if each.exists() and not each.is_file():
            raise UnwrittenError(f"{each.name} is there, and is not a regular file")
        if os.path.lexists(each) and not overwrite:
            raise UnwrittenError(EXISTS if each == path else f"{each.name}, which belongs to it, exists already")


def _beside(path: Path, suffix: str) -> Path:
    """A name beside a file, unique to it, and of bounded length."""
    return path.with_name(f".ccdepth-{sha256(os.fsencode(path.name)).hexdigest()[:16]}{suffix}")


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Keep other runs from writing a file meanwhile, and remove the remains of a killed run beside it.

    Raises UnwrittenError if another run writes it, and OSError.
    """
    lock = _beside(path, ".lock")
    try:
        held = _held(lock)
    except (BlockingIOError, FileExistsError) as fault:
        raise UnwrittenError("another run is writing it") from fault
    try:
        _remove_left(path)
        yield
    finally:
        _remove_left(path)
        if sys.platform != "win32":
            lock.unlink()
        os.close(held)


def _held(lock: Path) -> int:
    """A file that no other process can hold until it is closed or its process has gone. Raises BlockingIOError and
    FileExistsError if another process holds it."""
    if sys.platform == "win32":
        return os.open(lock, os.O_CREAT | os.O_EXCL | os.O_TEMPORARY)
    from fcntl import LOCK_EX, LOCK_NB, flock  # Windows has none.

    held = os.open(lock, os.O_CREAT | os.O_RDWR)
    try:
        flock(held, LOCK_EX | LOCK_NB)
        # The process that held the file until now has removed it.
        if not lock.exists() or not os.path.samestat(lock.stat(), os.fstat(held)):
            raise FileExistsError
    except OSError as fault:
        # There are file systems without locks.
        if fault.errno not in (ENOLCK, ENOTSUP):
            os.close(held)
            raise
    return held


def _remove_left(path: Path) -> None:
    """Remove the files written beside a file. Blender itself writes .blend files under their name and an @."""
    for suffix in (path.suffix, f"{path.suffix}@"):
        with suppress(OSError):
            _beside(path, suffix).unlink()
    shutil.rmtree(_beside(path, ""), ignore_errors=True)


@contextmanager
def written_whole(
    path: Path, *, backups: int = 0, companions: Sequence[str] = (), overwrite: bool = True
) -> Iterator[Path]:
    """A path to write to, for a file that takes the place of the claimed ``path`` afterwards, if whole, as far as can
    be told.

    backups: the number of earlier versions of the file to keep, named as by Blender: .blend1, .blend2, … companions:
    suffixes of files written beside it that belong to it. Raises UnwrittenError if the file is not whole or cannot be
    put there.
    """
    refuse_existing(path, overwrite, companions)
    beside = _beside(path, path.suffix)
    if companions:
        # Files that belong together know each other by their names.
        _beside(path, "").mkdir()
        beside = _beside(path, "") / path.name
    try:
        yield beside
    except Exception as fault:
        # Any failure on a full disk, in any state, and a quota or another limit.
        is_full = _is_full(path.absolute().parent)
        if isinstance(fault, UnwrittenError) or not (is_full or isinstance(fault, OSError)):
            raise
        raise UnwrittenError(f"it could not be written: {fault}{'; the disk is full' * is_full}") from fault
    try:
        check_whole(beside)
        refuse_existing(path, overwrite, companions)
        for suffix in companions:
            if beside.with_suffix(suffix).exists():
                os.replace(beside.with_suffix(suffix), path.with_suffix(suffix))
        if path.exists():
            shutil.copymode(path, beside)
            _keep(path, backups)
        _move(beside, path, overwrite)
    except UnwrittenError:
        raise
    except OSError as fault:
        raise UnwrittenError(f"it could not be written: {fault.strerror or fault}") from fault


def _move(beside: Path, target: Path, overwrite: bool) -> None:
    """Give a file its name. Raises UnwrittenError if it must not replace another file, even one that has come
    meanwhile, and OSError."""
    if not overwrite:
        try:
            os.link(beside, target)
            return
        except FileExistsError as fault:
            raise UnwrittenError(EXISTS) from fault
        except OSError:
            # There are file systems without links.
            refuse_existing(target, overwrite)
    os.replace(beside, target)


def _keep(target: Path, backups: int) -> None:
    """Move every version of the file on by one, except the last; the file itself stays."""
    versions = [target, *(target.with_name(f"{target.name}{number}") for number in range(1, backups + 1))]
    for older, newer in zip(versions[:0:-1], versions[-2::-1], strict=True):
        if newer == target:
            older.unlink(missing_ok=True)
            try:
                os.link(target, older)
            except OSError:
                # There are file systems without links.
                shutil.copy2(target, older)
        elif newer.exists():
            os.replace(newer, older)


def _is_full(folder: Path) -> bool:
    return shutil.disk_usage(folder).free < LEAST_FREE


def check_whole(path: Path) -> None:
    """Raise UnwrittenError unless the disk holds the file to its end, as far as can be told, and OSError."""
    with path.open("r+b") as file:
        # Some file systems report only now that the disk is full.
        os.fsync(file.fileno())
        is_whole = IS_WHOLE.get(path.suffix.lower(), _is_not_empty)
        try:
            whole = is_whole(file, os.fstat(file.fileno()).st_size)
        except struct.error:
            whole = False
    if not whole:
        raise UnwrittenError("it could not be written: it was cut off; is the disk full?")


def _is_whole_png(file: BinaryIO, size: int) -> bool:
    """Whether a .png file has every chunk to the last, with the right checksum."""
    if file.read(len(PNG_SIGNATURE)) != PNG_SIGNATURE:
        return False
    kind = b""
    while kind != b"IEND":
        length, kind = struct.unpack(">I4s", file.read(8))
        content = file.read(length)
        if struct.unpack(">I", file.read(4))[0] != crc32(content, crc32(kind)):
            return False
    return file.tell() == size


def _is_whole_blend(file: BinaryIO, size: int) -> bool:
    start = file.read(12)
    if start[:4] == ZSTANDARD_FRAME:
        return _has_all_frames(file, size)
    if start[:7] != b"BLENDER":
        return False
    if start[7:9].isdigit():
        return _has_all_blocks(file, size, int(start[7:9]), LARGE_BLOCK_HEADER, 3)
    return _has_all_blocks(file, size, len(start), BLOCK_HEADER, 1)


def _has_all_blocks(file: BinaryIO, size: int, position: int, header: struct.Struct, length_at: int) -> bool:
    """Whether block follows block up to the last block, at the end of the file."""
    kind = b""
    while kind != b"ENDB":
        file.seek(position)
        fields = header.unpack(file.read(header.size))
        kind = fields[0]
        position += header.size + fields[length_at]
    return position == size


def _has_all_frames(file: BinaryIO, size: int) -> bool:
    """Whether a file has the table of frames, and frames of the lengths listed there."""
    file.seek(max(0, size - SEEK_TABLE.size))
    frames, descriptor, mark = SEEK_TABLE.unpack(file.read(SEEK_TABLE.size))
    if mark != SEEK_TABLE_MARK:
        return False
    entry = struct.Struct("<III" if descriptor & HAS_CHECKSUMS else "<II")
    table_size = frames * entry.size + SEEK_TABLE.size
    file.seek(max(0, size - table_size))
    compressed = sum(fields[0] for fields in entry.iter_unpack(file.read(frames * entry.size)))
    return bool(compressed + SEEK_TABLE_HEADER_SIZE + table_size == size)


def _is_whole_stl(file: BinaryIO, size: int) -> bool:
    """Whether an .stl file has the number of triangles in its header, as binary files do."""
    file.seek(80)
    return bool(size == 84 + 50 * struct.unpack("<I", file.read(4))[0])


def _is_whole_glb(file: BinaryIO, size: int) -> bool:
    magic, _version, length = struct.unpack("<4sII", file.read(12))
    return bool(magic == b"glTF" and length == size)


def _is_not_empty(_file: BinaryIO, size: int) -> bool:
    return size > 0


IS_WHOLE = {PNG: _is_whole_png, ".blend": _is_whole_blend, ".stl": _is_whole_stl, ".glb": _is_whole_glb}
