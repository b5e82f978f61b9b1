"""Where recorded rows go: into memory, or chunk by chunk into a CSV, netCDF or Parquet file.

A file is written beside its final place and renamed when the run ends. A run that is interrupted, or fails, leaves what it has,
marked: netCDF attribute `status` and Parquet metadata `status` say `partial`, a CSV ends with the line `# partial`.

An existing file is replaced only if this module wrote it, or when forced. netCDF and Parquet carry `tool`; a CSV has no room for a
mark, so it counts as ours when its first column is `time` and its numbers are spelled as we spell them (shortest round trip).

Reports      BG619 a result file cannot be written
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from bgdsl.diagnostics import Code, Reporter
from bgdsl.ir.trajectory import Status
from bgdsl.simulate.columns import Column
from bgdsl.source import said
from bgdsl.version import VERSION

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

NO_OUTPUT = Code("BG619", "a result file cannot be written")

TOOL = f"bgdsl {VERSION}"
FORMATS = (".csv", ".nc", ".parquet")


class Sink(Protocol):
    """Takes rows in order of time: times (k,), values (k, m), which nobody writes over."""

    def write(self, times: Floats, values: Floats) -> None: ...

    def close(self, status: Status) -> None:
        """Finish; a file appears at its place. Called once."""
        ...

    def discard(self) -> None:
        """Leave nothing behind, instead of `close`."""
        ...


class MemorySink:
    """Keeps the rows."""

    def __init__(self, count: int):
        self._times: list[Floats] = []
        self._values: list[Floats] = []
        self._count = count

    def write(self, times: Floats, values: Floats) -> None:
        self._times.append(times)
        self._values.append(values)

    def close(self, status: Status) -> None:
        pass

    def discard(self) -> None:
        pass

    def rows(self) -> tuple[Floats, Floats]:
        """Everything written: (k,), (k, m)."""
        import numpy as np

        if not self._times:
            return np.zeros(0), np.zeros((0, self._count))
        if len(self._times) == 1:
            return self._times[0], self._values[0]
        return np.concatenate(self._times), np.concatenate(self._values)


def open_sink(path: Path, columns: Sequence[Column], model: str, digest: str, *, force: bool, report: Reporter) -> Sink:
    """A sink for the file's format. BgError where the format is unknown or the place is taken by somebody else's file."""
    where = said(str(path))
    if path.suffix.lower() not in FORMATS:
        missing = f"`{path}` is a folder" if path.is_dir() else f"`{path}` does not say in what format to write"
        what = f"`{path.suffix}` is no format for results" if path.suffix else missing
        report.fail(NO_OUTPUT, what, where, helps=(f"end its name with {', '.join(FORMATS)}",))
    if path.exists() and not force and not is_ours(path):
        report.fail(NO_OUTPUT, f"{path} exists and was not written by a run", where, helps=("`--force` replaces it",))
    names = ("time", *(column.name for column in columns))
    units = ("s", *(column.unit for column in columns))
    facts = {"tool": TOOL, "model": model, "digest": digest}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return _SINKS[path.suffix.lower()](path, names, units, facts)
    except OSError as error:
        cannot_write(path, error, report)


def cannot_write(path: Path | None, error: OSError, report: Reporter) -> NoReturn:
    """Stop for what the system says about a file."""
    place = str(path or "memory")
    report.fail(NO_OUTPUT, f"{place} cannot be written: {error.strerror or error}", said(place))


SPARE = 16384
"""Bytes a netCDF or Parquet file may need for each variable beside its numbers."""


class _Draft:
    """A temporary file beside its final place."""

    def __init__(self, path: Path):
        self.path = path
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        self.name = name

    def remove(self) -> None:
        Path(self.name).unlink(missing_ok=True)

    def need(self, size: int) -> None:
        """OSError unless so many bytes can still be written: HDF5 does not survive a full disk, and Parquet needs its footer."""
        if shutil.disk_usage(self.path.parent).free < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    @contextmanager
    def or_removed(self) -> Iterator[None]:
        """Do something with the file; where that fails (a full disk), nothing is left of it."""
        try:
            yield
        except BaseException:
            self.remove()
            raise

    def publish(self) -> None:
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(self.name, 0o666 & ~mask)
        os.replace(self.name, self.path)


class CsvSink:
    """One line a row; numbers in their shortest form that reads back to the same value."""

    def __init__(self, path: Path, names: Sequence[str], units: Sequence[str], facts: dict[str, str]):
        self._draft = _Draft(path)
        with self._draft.or_removed():
            self._file = Path(self._draft.name).open("w", encoding="utf-8", newline="\n")  # noqa: SIM115  (closed by `close`)
            self._file.write(",".join(_quoted(name) for name in names) + "\n")

    def write(self, times: Floats, values: Floats) -> None:
        for time, row in zip(times.tolist(), values.tolist(), strict=True):
            self._file.write(",".join(map(repr, (time, *row))) + "\n")

    def close(self, status: Status) -> None:
        with self._draft.or_removed():
            if status == "partial":
                self._file.write("# partial\n")
            self._file.close()
            self._draft.publish()

    def discard(self) -> None:
        self._draft.remove()
        self._file.close()


def _quoted(name: str) -> str:
    return f'"{name}"' if "," in name else name


class NetcdfSink:
    """One variable a column over the unlimited dimension `time`; units as attributes."""

    CHUNK = 4096

    def __init__(self, path: Path, names: Sequence[str], units: Sequence[str], facts: dict[str, str]):
        import h5netcdf

        self._draft = _Draft(path)
        with self._draft.or_removed():
            self._draft.need(SPARE * (1 + len(names)))
            self._file = h5netcdf.File(self._draft.name, "w")
        self._file.dimensions = {"time": None}
        self._rows = 0
        for key, value in facts.items():
            self._file.attrs[key] = value
        self._file.attrs["status"] = "partial"
        self._variables = []
        for name, unit in zip(names, units, strict=True):
            variable = self._file.create_variable(_slashless(name), ("time",), "f8", chunks=(self.CHUNK,))
            if unit:
                variable.attrs["units"] = unit
            self._variables.append(variable)

    def write(self, times: Floats, values: Floats) -> None:
        end = self._rows + len(times)
        self._draft.need((8 * (len(times) + self.CHUNK) + SPARE) * (1 + len(self._variables)))
        self._file.resize_dimension("time", end)
        for variable, column in zip(self._variables, (times, *values.T), strict=True):
            variable[self._rows : end] = column
        self._rows = end

    def close(self, status: Status) -> None:
        with self._draft.or_removed():
            self._file.attrs["status"] = status
            self._file.close()
            self._draft.publish()

    def discard(self) -> None:
        self._draft.remove()
        self._file.close()


def _slashless(name: str) -> str:
    return name.replace("/", "|")


class ParquetSink:
    """One column a variable, a row group a chunk."""

    def __init__(self, path: Path, names: Sequence[str], units: Sequence[str], facts: dict[str, str]):
        import pyarrow
        from pyarrow import parquet

        self._draft = _Draft(path)
        fields = [
            pyarrow.field(name, pyarrow.float64(), nullable=False, metadata={"units": unit} if unit else None)
            for name, unit in zip(names, units, strict=True)
        ]
        self._schema = pyarrow.schema(fields, metadata=facts)
        with self._draft.or_removed():
            self._writer = parquet.ParquetWriter(self._draft.name, self._schema)

    def write(self, times: Floats, values: Floats) -> None:
        import numpy as np
        import pyarrow

        columns: list[Any] = [pyarrow.array(np.ascontiguousarray(column)) for column in (times, *values.T)]
        self._draft.need((9 * len(times) + SPARE) * len(columns))
        with self._draft.or_removed():
            self._writer.write_table(pyarrow.Table.from_arrays(columns, schema=self._schema))

    def close(self, status: Status) -> None:
        with self._draft.or_removed():
            self._writer.add_key_value_metadata({"status": status})
            self._writer.close()
            self._draft.publish()

    def discard(self) -> None:
        self._draft.remove()
        self._writer.close()


_SINKS: dict[str, Callable[[Path, Sequence[str], Sequence[str], dict[str, str]], Sink]] = {
    ".csv": CsvSink,
    ".nc": NetcdfSink,
    ".parquet": ParquetSink,
}


def is_ours(path: Path) -> bool:
    """Whether a run wrote this file."""
    try:
        match path.suffix.lower():
            case ".nc":
                import h5netcdf

                with h5netcdf.File(path, "r") as file:
                    return str(file.attrs.get("tool", "")).startswith("bgdsl ")
            case ".parquet":
                from pyarrow import parquet

                metadata = parquet.read_schema(path).metadata or {}
                return bytes(metadata.get(b"tool", b"")).startswith(b"bgdsl ")
            case _:
                return _is_our_csv(path)
    except Exception:
        return False  # unreadable: somebody else's


def _is_our_csv(path: Path) -> bool:
    with path.open(encoding="utf-8") as file:
        header, first = file.readline(), file.readline()
    if header.rstrip("\n").split(",")[0] != "time":
        return False
    fields = first.rstrip("\n").split(",")
    return first.startswith("#") or first == "" or all(_spelled_as_ours(field) for field in fields)


def _spelled_as_ours(field: str) -> bool:
    try:
        return repr(float(field)) == field
    except ValueError:
        return False
