# SPDX-License-Identifier: GPL-3.0-or-later
"""Files written as a whole or not at all.

On a full disk, Blender still reports that it has saved a file or written a picture. So files are written beside their
place, read back by their writers, and only then moved there.

The given name decides the format, and a link is replaced, not followed.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path

PNG = ".png"

# The least free space in bytes; with less, the next write does not fit.
LEAST_FREE = 1 << 16


class UnwrittenError(OSError):
    """The error of a file that could not be written as a whole; the earlier file is still there. The message says
    why."""


def refuse_existing(path: Path, overwrite: bool, companions: Sequence[str] = ()) -> None:
    """Raise UnwrittenError if something there has to stay: a file without ``overwrite``, a device or a folder always.

    companions: suffixes of files that belong to it, and are checked as well.
    """
    for each in (path, *(path.with_suffix(suffix) for suffix in companions)):
        if each.exists() and not each.is_file():
            raise UnwrittenError(f"{each.name} is there, and is not a regular file")
        if os.path.lexists(each) and not overwrite:
            what = "it" if each == path else f"{each.name}, which belongs to it,"
            raise UnwrittenError(f"{what} exists already; use --overwrite to replace it")


def _beside(path: Path, suffix: str) -> Path:
    """A name beside a file, unique to it, and of bounded length."""
    return path.with_name(f".ccdepth-{sha256(os.fsencode(path.name)).hexdigest()[:16]}{suffix}")


def remove_left(path: Path) -> None:
    """Remove the files that a run has left beside a file. Blender itself writes .blend files under their name and an
    @."""
    for suffix in (path.suffix, f"{path.suffix}@"):
        with suppress(OSError):
            _beside(path, suffix).unlink()
    shutil.rmtree(_beside(path, ""), ignore_errors=True)


@contextmanager
def written_whole(path: Path, *, companions: Sequence[str] = (), overwrite: bool = True) -> Iterator[Path]:
    """A path to write to, for a file that takes the place of ``path`` afterwards.

    companions: suffixes of files written beside it that belong to it. Raises UnwrittenError if the file is empty or
    cannot be written or put there; other errors of the caller are passed on.
    """
    remove_left(path)
    beside = _beside(path, path.suffix)
    try:
        if companions:
            # Files that belong together know each other by their names.
            _beside(path, "").mkdir()
            beside = _beside(path, "") / path.name
        yield beside
        _put_there(beside, path, companions, overwrite)
    except UnwrittenError:
        raise
    except Exception as fault:
        # Any failure on a full disk, in any state, and a quota or another limit.
        is_full = shutil.disk_usage(path.absolute().parent).free < LEAST_FREE
        if not (is_full or isinstance(fault, OSError)):
            raise
        raise UnwrittenError(f"it could not be written: {fault}{'; the disk is full' * is_full}") from fault
    finally:
        remove_left(path)


def _put_there(beside: Path, path: Path, companions: Sequence[str], overwrite: bool) -> None:
    """Give a written file its place. Raises UnwrittenError if it is empty, or must not replace another file, even one
    that has come meanwhile, and OSError."""
    with beside.open("r+b") as file:
        # Some file systems report only now that the disk is full.
        os.fsync(file.fileno())
        if not os.fstat(file.fileno()).st_size:
            raise UnwrittenError("it could not be written: it was cut off; is the disk full?")
    refuse_existing(path, overwrite, companions)
    if path.exists():
        shutil.copymode(path, beside)
    for suffix in companions:
        if beside.with_suffix(suffix).exists():
            os.replace(beside.with_suffix(suffix), path.with_suffix(suffix))
    os.replace(beside, path)
