"""The files of a run: every name planned before any work, all of them written or none.

A run writes one main file (`OUT.rrd`, say) and files beside it that share its stem, one a dancer:
`OUT.npz` for the first, `OUT.dancer_2.npz` for the next. No output is ever an input of the run,
links and other spellings of its name included, and only files that this tool wrote are replaced.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dance2pose.errors import OutputError, OutputExistsError, UsageError
from dance2pose.leftovers import aside_name, temporary_name
from dance2pose.output_files import check_output, output_error

# A file that this tool wrote names it near its start or its end.
_MARK = b"dance2pose"
_LOOKED_AT_BYTES = 1 << 18
# The poses of the first version hold no mark; they hold these arrays.
_FIRST_VERSION = (b"skeleton.npy", b"joints.npy", b"time_s.npy")
# Suffixes of two parts that belong together.
_TWO_PARTS = (".track.npz", ".body.toml", ".long.csv", ".keypoints.csv", ".phrases.csv")
_PER_DANCER = re.compile(r"\.dancer_\d+")


@dataclass(frozen=True)
class OutputPlan:
    """The names of a run, checked before it begins.

    main: the file that was asked for. beside: suffixes of the files beside it, one file a dancer.
    earlier: files of an earlier run that this one replaces or, with fewer dancers, removes.
    """

    main: Path
    beside: tuple[str, ...] = ()
    earlier: tuple[Path, ...] = field(default=(), repr=False)

    def name(self, suffix: str, person: int | None = None) -> Path:
        """The file of a dancer; None for the first, or for one file of all dancers."""
        return self.main.with_name(f"{_stem(self.main)}{_dancer(person)}{suffix}")

    @contextlib.contextmanager
    def writing(self) -> Iterator[Staged]:
        """Write within the block; all files appear when it ends well, none otherwise.

        Raises OutputError for what the file system refuses; files of an earlier run are then as
        they were.
        """
        staged = Staged(self)
        try:
            yield staged
            staged.commit()
        finally:
            staged.discard()


def plan_outputs(
    main: Path,
    *,
    kinds: Sequence[str],
    beside: Sequence[str] = (),
    inputs: Sequence[Path | None] = (),
    overwrite: bool = False,
) -> OutputPlan:
    """Plan the files of a run, before any work is spent on it.

    Parameters
    ----------
    main
        The file asked for.
    kinds
        The suffixes it may have.
    beside
        Suffixes of the files beside it, one file for every dancer.
    inputs
        Files that the run reads; None is left out.
    overwrite
        Whether files that this tool wrote may be replaced.

    Raises
    ------
    UsageError
        For another suffix, two outputs of one name, or an output that is an input.
    OutputExistsError
        Where a file exists already, and may not be replaced.
    OutputError
        Where the folder is missing or cannot be written to.
    """
    check_no_input(main, inputs)
    if _suffix(main) not in kinds:
        known = " or ".join(kinds)
        raise UsageError(f"{main}: expected a name that ends in {known}")
    plan = OutputPlan(main, tuple(suffix for suffix in beside if suffix != _suffix(main)))
    names = [main, *(plan.name(suffix) for suffix in plan.beside)]
    if len(set(names)) < len(names):
        raise UsageError(f"{main}: two outputs would have one name; choose another with -o")
    earlier = _earlier(plan)
    for path in {*names, *earlier}:
        check_no_input(path, inputs)
    check_output(main, overwrite=True)  # the folder, and whether it can be written to
    for path in sorted(earlier):
        check_may_replace(path, overwrite=overwrite)
    return OutputPlan(main, plan.beside, tuple(sorted(earlier)))


def check_may_replace(path: Path, *, overwrite: bool) -> None:
    """Raise OutputExistsError unless `path` is free, or a file of ours that may be replaced."""
    if not path.exists() and not path.is_symlink():
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder, expected the name of a file to write")
    if not overwrite:
        raise OutputExistsError(f"{path}: exists already; give --overwrite or another name with -o")
    if not wrote(path):
        raise OutputExistsError(
            f"{path}: exists already and was not written by dance2pose, so that --overwrite does "
            "not replace it; remove it yourself or give another name with -o"
        )


def wrote(path: Path) -> bool:
    """Whether this tool wrote `path`: it names it within, or one of its own files lies beside it
    under the same name (for forms that cannot hold a word of their making)."""
    if _is_marked(path):
        return True
    stem = _PER_DANCER.sub("", _stem(path))
    others = [path.with_name(stem + suffix) for suffix in (".rrd", ".npz")]
    return any(other != path and other.is_file() and _is_marked(other) for other in others)


def _is_marked(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            start = file.read(_LOOKED_AT_BYTES)
            file.seek(max(0, path.stat().st_size - _LOOKED_AT_BYTES))
            end = file.read()
    except OSError:
        return False
    if path.suffix == ".npz" and all(name in end for name in _FIRST_VERSION):
        return True
    return _MARK in start or _MARK in end


def _stem(path: Path) -> str:
    return path.name.removesuffix(_suffix(path))


def _suffix(path: Path) -> str:
    """The suffix with its first part where it has two that belong together (.track.npz)."""
    two = "".join(path.suffixes[-2:]).lower()
    return two if two in _TWO_PARTS else path.suffix.lower()


def _dancer(person: int | None) -> str:
    return "" if person is None else f".dancer_{person}"


def _earlier(plan: OutputPlan) -> set[Path]:
    """Files that exist under the names of this run, whatever the number of dancers."""
    found = {plan.main} if os.path.lexists(plan.main) else set()
    if not plan.main.parent.is_dir():
        return found
    endings = {f"{_stem(plan.main)}{{}}{suffix}" for suffix in (_suffix(plan.main), *plan.beside)}
    patterns = [
        re.compile(re.escape(ending).replace(r"\{\}", r"(\.dancer_\d+)?")) for ending in endings
    ]
    for entry in plan.main.parent.iterdir():
        if any(pattern.fullmatch(entry.name) for pattern in patterns):
            found.add(entry)
    return found


def check_no_input(path: Path, inputs: Sequence[Path | None]) -> None:
    """Raise UsageError where the output would replace an input, under whatever name."""
    for source in inputs:
        if source is None:
            continue
        same = path.resolve() == Path(source).resolve()
        with contextlib.suppress(OSError):
            same = same or path.samefile(source)
        if same:
            raise UsageError(
                f"{path}: is an input of this run, and no output replaces it; "
                "give another name with -o"
            )


class Staged:
    """Files of a run under temporary names, until all of them are there."""

    def __init__(self, plan: OutputPlan) -> None:
        self._plan = plan
        self._temporary: dict[Path, Path] = {}

    @property
    def files(self) -> tuple[Path, ...]:
        """The names that the files will have, in the order in which they were asked for."""
        return tuple(self._temporary)

    def path(self, final: Path) -> Path:
        """Where to write the file that will be `final`: a hidden name in the same folder."""
        if final not in self._temporary:
            self._temporary[final] = temporary_name(final)
        return self._temporary[final]

    def commit(self) -> None:
        """Give all files their names; files of an earlier run go. All or none."""
        aside: dict[Path, Path] = {}
        placed: list[Path] = []
        replaced = {*self._plan.earlier, *self._temporary}
        try:
            for final, temporary in self._temporary.items():
                with temporary.open("r+b") as written:
                    os.fsync(written.fileno())
                if final not in self._plan.earlier and os.path.lexists(final):
                    raise OutputExistsError(f"{final}: appeared while it was being made; kept")
            for path in sorted(replaced):
                if os.path.lexists(path):
                    aside[path] = aside_name(path)
                    path.rename(aside[path])
            for final, temporary in self._temporary.items():
                temporary.rename(final)
                placed.append(final)
        except BaseException as error:
            for final in placed:
                final.unlink(missing_ok=True)
            for path, kept in aside.items():
                kept.rename(path)
            if isinstance(error, OSError):
                raise output_error(self._plan.main, error) from error
            raise
        for kept in aside.values():
            kept.unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove what was not given its name."""
        for temporary in self._temporary.values():
            temporary.unlink(missing_ok=True)
