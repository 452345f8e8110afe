"""Fetching a model of the registry: download with resume, check, unpack, try, keep."""

from __future__ import annotations

import contextlib
import errno
import http.client
import queue
import ssl
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from dance2pose.errors import ModelError, OutputError
from dance2pose.file_hash import file_sha256
from dance2pose.onnx_models.manifest import checked_settings, manifest_path, toml_lines
from dance2pose.onnx_models.recognition import inspect_model
from dance2pose.onnx_models.registry import (
    RegisteredModel,
    cache_folder,
    cached_path,
    known_hashes,
    record_hashes,
)
from dance2pose.output_files import written_whole
from dance2pose.progress import Progress, Silent

CHUNK_BYTES = 1024**2
LARGEST_MODEL_BYTES = 2 * 1024**3
TIMEOUT_S = 30.0
# The whole of an answer's beginning must be there by then, and from then on no fewer bytes than
# these in every window: a server that drips would otherwise hold a run for ever.
ANSWER_S = 60.0
WINDOW_S, LEAST_BYTES = 60.0, 64 * 1024
# The list of files in a zip; that of a model's archive has a few kilobytes.
LARGEST_ZIP_LIST_BYTES = 16 * 1024**2
ATTEMPTS = 5  # in a row that bring nothing new
PAUSE_S = 1.0


@dataclass(frozen=True)
class Pulled:
    """A pulled model. first_download: its hash was not known before and is now recorded."""

    path: Path
    sha256: str
    first_download: bool


def pull(model: RegisteredModel, *, progress: Progress | None = None) -> Pulled:
    """Download a model into the cache, check it, and write its manifest beside it.

    A download that was cut goes on where it stopped, now or at the next call. Nothing appears
    under the model's name before its hash, its archive and the model itself have been checked.
    Raises ModelError for what is wrong with the download, OutputError for what the disk refuses.
    """
    progress = progress or Silent()
    partial = cache_folder() / f"{model.name}.download"
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        _download(model.url, partial, progress)
        recorded = known_hashes().get(model.name, {})
        expected = model.sha256 or recorded.get("download")
        download_hash = file_sha256(partial)
        if expected not in (None, download_hash):
            _discard(partial)
            raise ModelError(
                f"{model.url}: sha256 is {download_hash}, expected {expected}; the file was "
                f"thrown away. Either the download is damaged or the publisher changed it"
            )
        model_hash = _install(model, partial)
        if not recorded:
            record_hashes(model.name, download=download_hash, model=model_hash)
        _discard(partial)
    except OutputError:
        _discard(partial)
        raise
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            _discard(partial)
            raise OutputError(
                f"{cache_folder()}: the disk is full; the download was thrown away"
            ) from error
        raise OutputError(f"{cache_folder()}: {error.strerror or error}") from error
    return Pulled(cached_path(model.name), model_hash, expected is None)


def _install(model: RegisteredModel, download: Path) -> str:
    """Unpack, try, and put model and manifest in place. Returns the model's SHA-256."""
    target = cached_path(model.name)
    settings = dict(model.manifest) | {
        "name": model.name,
        "source": model.url,
        "license": model.license,
    }
    with (
        written_whole(manifest_path(target), overwrite=True) as manifest,
        written_whole(target, overwrite=True) as unpacked,
    ):
        if model.archive_member is None:
            with download.open("rb") as source, unpacked.open("wb") as file:
                _copy(source, file, model.url)
        else:
            _take_member(download, model.archive_member, unpacked, model.url)
        lines = toml_lines(checked_settings(settings, where=model.name) | {"model": target.name})
        manifest.write_text("\n".join(lines) + "\n", encoding="utf-8")
        inspect_model(unpacked, manifest)
        return file_sha256(unpacked)


def _take_member(archive: Path, name: str, target: Path, url: str) -> None:
    """Copy the one file called `name` out of a zip; its folders there mean nothing here."""
    _check_zip_list(archive, url)
    try:
        with zipfile.ZipFile(archive) as content:
            members = content.infolist()
            for member in members:
                place = PurePosixPath(member.filename.replace("\\", "/"))
                if place.is_absolute() or ".." in place.parts or ":" in place.parts[0]:
                    raise ModelError(
                        f"{url}: the archive names a file outside of itself "
                        f"({member.filename!r}); nothing was unpacked"
                    )
            found = [m for m in members if PurePosixPath(m.filename).name == name]
            if len(found) != 1:
                inside = ", ".join(m.filename for m in members[:10]) or "nothing"
                raise ModelError(
                    f"{url}: the archive has {len(found)} files called {name}, expected one; "
                    f"it holds {inside}"
                )
            if found[0].file_size > LARGEST_MODEL_BYTES:
                raise ModelError(f"{url}: {name} unpacks to {found[0].file_size} bytes, too large")
            with content.open(found[0]) as source, target.open("wb") as file:
                _copy(source, file, url)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise ModelError(f"{url}: what was downloaded is not a sound zip: {error}") from error


def _check_zip_list(archive: Path, url: str) -> None:
    """Refuse a zip whose list of files would take gigabytes to read, before it is read.

    The zip's last record (APPNOTE.TXT 4.3.16) tells the list's size at byte 12.
    """
    with archive.open("rb") as file:
        file.seek(max(0, archive.stat().st_size - 22 - 65535))
        end = file.read()
    place = end.rfind(b"PK\5\6")
    size = int.from_bytes(end[place + 12 : place + 16], "little") if place >= 0 else 0
    if size > LARGEST_ZIP_LIST_BYTES:
        raise ModelError(f"{url}: the archive's list of files has {size} bytes, too many")


def _copy(source: IO[bytes], target: IO[bytes], url: str) -> None:
    copied = 0
    while chunk := source.read(CHUNK_BYTES):
        copied += len(chunk)
        if copied > LARGEST_MODEL_BYTES:
            raise ModelError(f"{url}: unpacks to more than {LARGEST_MODEL_BYTES} bytes, too large")
        target.write(chunk)


# The download ---------------------------------------------------------------------------------


def _download(url: str, partial: Path, progress: Progress) -> None:
    """Make `partial` the whole file at `url`, going on with what is there of it already.

    A partial file is only continued under the validator (ETag or date) it was begun with, kept
    beside it; without one it is begun anew.
    """
    _check_address(url)
    most = in_vain = 0
    while in_vain < ATTEMPTS:
        time.sleep(in_vain * PAUSE_S)
        failure = "the connection was cut"
        drips = False
        try:
            if _fetch(url, partial, progress):
                return
        except urllib.error.HTTPError as error:
            failure = f"the server answered {error.code} {error.reason}"
            if error.code not in _WORTH_A_RETRY:
                raise ModelError(f"{url}: {failure}") from error
        except urllib.error.URLError as error:
            failure = str(error.reason)
        except TooSlowError as error:
            failure, drips = str(error), True
        except (http.client.HTTPException, TimeoutError, ConnectionError, ssl.SSLError) as error:
            failure = str(error) or failure
        size = partial.stat().st_size if partial.exists() else 0
        in_vain = 0 if size > most and not drips else in_vain + 1
        most = max(most, size)
    raise ModelError(
        f"{url}: cannot be downloaded: {failure}, {ATTEMPTS} times; {size} bytes are kept, "
        f"and the same command goes on from there"
    )


class TooSlowError(Exception):
    """The server sends so little that the file would never be there."""


_WORTH_A_RETRY = frozenset({408, 429, 500, 502, 503, 504})
_RANGE_NOT_SATISFIABLE = 416


def _check_address(url: str) -> None:
    parts = urllib.parse.urlsplit(url)
    if parts.scheme != "https" and not (parts.scheme == "http" and parts.hostname == "127.0.0.1"):
        raise ModelError(f"{url}: models are only fetched over https")


class _SafeRedirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects, but only to addresses that would have been asked in the first place."""

    def redirect_request(
        self,
        req: urllib.request.Request,
        fp: IO[bytes],
        code: int,
        msg: str,
        headers: http.client.HTTPMessage,
        newurl: str,
    ) -> urllib.request.Request | None:
        _check_address(newurl)
        if req.type == "https" and not newurl.lower().startswith("https:"):
            raise ModelError(f"{req.full_url}: leads to {newurl}, which is not https")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _fetch(url: str, partial: Path, progress: Progress) -> bool:
    """One attempt; False where the connection ended before the file did."""
    validator_file = partial.with_suffix(".validator")
    validator = validator_file.read_text("utf-8") if validator_file.exists() else ""
    have = partial.stat().st_size if partial.exists() and validator else 0
    request = urllib.request.Request(url, headers={"User-Agent": "dance2pose"})
    if have:
        request.add_header("Range", f"bytes={have}-")
        request.add_header("If-Range", validator)
    opener = urllib.request.build_opener(_SafeRedirects)
    try:
        response = _answer(opener, request)
    except urllib.error.HTTPError as error:
        if error.code != _RANGE_NOT_SATISFIABLE:
            raise
        _discard(partial)  # it holds as much as, or more than, the file has: begin anew
        return False
    with response:
        resumed = response.status == http.client.PARTIAL_CONTENT
        length = response.headers.get("Content-Length")
        left = int(length) if length and length.isdecimal() else None
        if (left or 0) > LARGEST_MODEL_BYTES:
            raise ModelError(f"{url}: holds {left} bytes, more than any model here")
        validator_file.write_text(
            response.headers.get("ETag") or response.headers.get("Last-Modified") or "", "utf-8"
        )
        with partial.open("ab" if resumed else "wb") as file:
            received = _receive(response, file, url, left, progress)
    return left is None or received == left


def _answer(
    opener: urllib.request.OpenerDirector, request: urllib.request.Request
) -> http.client.HTTPResponse:
    """The beginning of an answer. Raises TooSlowError where it is not there in time."""
    came: queue.SimpleQueue[http.client.HTTPResponse | BaseException] = queue.SimpleQueue()

    def ask() -> None:
        try:
            came.put(opener.open(request, timeout=TIMEOUT_S))
        except BaseException as error:  # handed to the thread that waits
            came.put(error)

    threading.Thread(target=ask, name="download", daemon=True).start()
    try:
        answer = came.get(timeout=ANSWER_S)
    except queue.Empty:
        raise TooSlowError(f"the server had not answered after {ANSWER_S:g} s") from None
    if isinstance(answer, BaseException):
        raise answer
    return answer


def _receive(
    response: http.client.HTTPResponse,
    file: IO[bytes],
    url: str,
    left: int | None,
    progress: Progress,
) -> int:
    """Write what comes; returns the number of bytes."""

    def chunks() -> Iterator[bytes]:
        began, in_window, gathered = time.monotonic(), 0, bytearray()
        while piece := response.read1(CHUNK_BYTES):
            gathered += piece
            in_window += len(piece)
            if time.monotonic() - began > WINDOW_S:
                if in_window < LEAST_BYTES:
                    raise TooSlowError(f"the server sent {in_window} bytes in {WINDOW_S:g} s")
                began, in_window = time.monotonic(), 0
            if len(gathered) >= CHUNK_BYTES:
                yield bytes(gathered)
                gathered.clear()
        if gathered:
            yield bytes(gathered)

    received = 0
    total = None if left is None else -(-left // CHUNK_BYTES)
    name = PurePosixPath(urllib.parse.urlsplit(url).path).name
    for chunk in progress.track(chunks(), f"downloading {name}", total=total, unit="MiB"):
        received += len(chunk)
        if file.tell() + len(chunk) > LARGEST_MODEL_BYTES:
            raise ModelError(f"{url}: sends more than {LARGEST_MODEL_BYTES} bytes, too large")
        file.write(chunk)
    return received


def _discard(partial: Path) -> None:
    with contextlib.suppress(OSError):
        partial.unlink(missing_ok=True)
        partial.with_suffix(".validator").unlink(missing_ok=True)
