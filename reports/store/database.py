"""The SQLite file of a results store: what is read is what was written, or it is refused in words.

SQLite's rollback journal makes every transaction whole or absent, also after `kill -9`. Most changes of bytes in the
file it does not notice. So the file keeps a seal, the sum of a digest of every record: each transaction brings it up to
date, and whoever opens the file adds up again.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from shading_atlas_bench.errors import BenchError

Cell: TypeAlias = str | int | float | None  # of a table
Record: TypeAlias = tuple[Cell, ...]

LONGEST_PATH = 504  # bytes, of a file that SQLite opens with its journal beside it
WAIT_SECONDS = 60  # for another process that writes to the same file
SEAL = "CREATE TABLE seal (value INTEGER NOT NULL)"
_MODULUS = 1 << 62  # of sums of digests: SQLite's integers hold the sum of two
_NEVER_WRITTEN = {sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH}
_OF_VALUES = (sqlite3.InterfaceError, sqlite3.ProgrammingError, sqlite3.DataError, OverflowError, UnicodeError)
_IN_USE = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}


class StoreError(BenchError, ValueError):
    """A store that cannot be used, or a value that does not belong in it; the message is for people."""


class StoreFileError(StoreError):
    """A file of results that cannot be read or written, whatever belongs in it."""


class Database:
    """One file with the given tables.

    tables: the statements that create them and their indices. version: of this layout; a file of another is refused.
    made: whether they are made where there is no file, or an empty one; else nothing is written before it is whole.
    checked: whether the seal is looked at, which takes as long as reading everything.
    Raises StoreError, one sentence that names the file, if it cannot be used as it is, or a value cannot be kept, and
    StoreFileError if it is damaged, or cannot be read or written, now and later.
    """

    def __init__(
        self, file: Path, tables: Sequence[str], version: int, *, made: bool = True, checked: bool = True
    ) -> None:
        self.file, self._statements, self._version = file, (*tables, SEAL), version
        self._added = 0  # digests of what the transaction inserted, less those of what it deleted
        long = len(os.fsencode(file.absolute()))
        if long > LONGEST_PATH:
            own = len(file.name) + 1
            raise StoreError(
                f"The folder's path has {long - own:,} bytes, and SQLite opens files in up to {LONGEST_PATH - own}: "
                "give a folder whose path is shorter."
            )
        if os.path.lexists(file) and not file.is_file():  # other things might block, or lead elsewhere
            raise StoreFileError(f"{file} is no file: delete it, or give another folder.")
        if not made and not file.is_file():
            raise StoreError(self._without_results())
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreFileError(f"{file.parent} cannot be made ({error.strerror}): give another folder.") from error
        with self._in_words():
            self._connection = sqlite3.connect(file, timeout=WAIT_SECONDS, isolation_level=None)
        try:
            self._open(made, checked)
        except BaseException:
            self._connection.close()
            raise

    def close(self) -> None:
        """Close the file; nothing is pending, so this loses nothing."""
        self._connection.close()

    def select(self, query: str, values: Sequence[Cell] = ()) -> list[tuple[Any, ...]]:
        """All that a query finds; of what types that is, the query knows."""
        with self._in_words():
            return self._connection.execute(query, values).fetchall()

    def select_named(self, query: str) -> list[dict[str, Any]]:
        """The same, by column names."""
        with self._in_words():
            cursor = self._connection.execute(query)
            names = [description[0] for description in cursor.description]
            return [dict(zip(names, record, strict=True)) for record in cursor]

    def insert(self, table: str, records: Sequence[Record]) -> None:
        """Add whole records within a transaction, each cell of its column's own type, numbers finite: what SQLite would
        change would break the seal. Raises sqlite3.IntegrityError for two of one key."""
        if records:
            places = ", ".join("?" * len(records[0]))
            self._connection.executemany(f"INSERT INTO {table} VALUES ({places})", records)
            self._added += _digests(table, records)

    def delete(self, table: str, **where: Cell) -> int:
        """Take the records with these values out within a transaction; how many there were."""
        condition = " AND ".join(f"{name} = ?" for name in where) or "TRUE"
        values = tuple(where.values())
        gone = self.select(f"SELECT * FROM {table} WHERE {condition}", values)
        if gone:
            self._connection.execute(f"DELETE FROM {table} WHERE {condition}", values)
            self._added -= _digests(table, gone)
        return len(gone)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """What is inserted and deleted in the block is written as a whole, or not at all if it raises."""
        with self._in_words(), self._within("BEGIN IMMEDIATE"):
            self._added = 0
            yield
            change = (self._added % _MODULUS, _MODULUS)
            self._connection.execute("UPDATE seal SET value = (value + ?) % ?", change)

    @contextmanager
    def _within(self, begin: str) -> Iterator[None]:
        self._connection.execute(begin)
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:  # on a full disk SQLite has rolled it back already
                self._connection.execute("ROLLBACK")
            raise

    def _open(self, made: bool, checked: bool) -> None:
        """Make the tables of a new file, or check an old one."""
        with self._in_words():
            if self._is_new():
                if not made:
                    raise StoreError(self._without_results())
                with self._within("BEGIN IMMEDIATE"):
                    if self._is_new():  # still: another process may have been faster
                        self._make_tables()
            if self._found_version() != self._version:
                raise StoreError(
                    f"{self.file} was written by another program, or by another version of this one, with other "
                    "columns: use that, or run again into a new folder."
                )
            if checked:
                with self._within("BEGIN"):  # one state of the file, whoever writes meanwhile
                    self._check()

    def _is_new(self) -> bool:
        """Whether nothing was ever made in the file."""
        return not self._found_version() and not self.select("SELECT 1 FROM sqlite_master LIMIT 1")

    def _make_tables(self) -> None:
        for statement in self._statements:
            self._connection.execute(statement)
        self._connection.execute("INSERT INTO seal VALUES (0)")
        self._connection.execute(f"PRAGMA user_version = {self._version}")

    def _without_results(self) -> str:
        return f"There are no results in {self.file.parent}: give a folder that `bench run` wrote."

    def _found_version(self) -> int:
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        return int(version)

    def _check(self) -> None:
        """Raise StoreFileError unless the tables are those that were made, and hold what was written."""
        found = self.select("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")
        if sorted(str(sql) for (sql,) in found) != sorted(self._statements):
            raise self._damaged("its tables are others")
        ((said,),) = self.select("PRAGMA integrity_check(1)")  # indices, which may answer in place of their tables
        if said != "ok":
            raise self._damaged(" ".join(str(said).split()))
        if self.select("SELECT value FROM seal") != [(self._sum(),)]:
            raise self._damaged("its checksum does not hold")

    def _sum(self) -> int:
        """What the seal has to be."""
        tables = [statement.split()[2] for statement in self._statements if statement.startswith("CREATE TABLE")]
        found = (_digests(table, self.select(f"SELECT * FROM {table}")) for table in tables if table != "seal")
        return sum(found) % _MODULUS

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Errors of SQLite become StoreErrors, but for that of two records of one key."""
        try:
            yield
        except sqlite3.IntegrityError:
            raise
        except _OF_VALUES as error:
            raise StoreError(f"A value cannot be kept in {self.file} ({error}).") from error
        except sqlite3.Error as error:
            raise self._error_of(error) from error

    def _error_of(self, error: sqlite3.Error) -> StoreFileError:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # what is above says more, which the text does, too
        if not self.file.parent.is_dir() or (code != sqlite3.SQLITE_CANTOPEN and not self.file.is_file()):
            return StoreFileError(f"{self.file} was deleted or moved while it was in use: run again.")
        if code == sqlite3.SQLITE_FULL:
            return StoreFileError(f"{self.file} cannot be written, for the disk is full: make room, and run again.")
        if code in _NEVER_WRITTEN:
            return StoreFileError(f"{self.file} cannot be written ({error}): make it and its folder writable.")
        if code in _IN_USE:
            return StoreFileError(f"{self.file} is in use by another program: wait for it, and run again.")
        if code == sqlite3.SQLITE_IOERR:
            return StoreFileError(f"{self.file} cannot be read or written ({error}): mend its disk, and run again.")
        return self._damaged(str(error))

    def _damaged(self, what: str) -> StoreFileError:
        return StoreFileError(
            f"{self.file} is no whole results store ({what}): put back a copy of it, or run again into a new folder."
        )


def _digests(table: str, records: Sequence[Record]) -> int:
    """The sum of the digests of a table's records."""
    return sum(_digest(table, record) for record in records)


def _digest(table: str, record: Record) -> int:
    """A number of 64 bits from a table's name and a record, as it was given to SQLite or as SQLite gives it back."""
    # SQLite has one zero. What is no cell, which only damage brings about, counts as its text.
    cells = [cell + 0.0 if isinstance(cell, float) else cell for cell in record]
    text = json.dumps([table, *cells], default=repr)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")
