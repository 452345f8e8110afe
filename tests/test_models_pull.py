"""`models pull` against a server on 127.0.0.1 that cuts, changes, lies and misbehaves."""

from __future__ import annotations

import hashlib
import http.server
import io
import resource
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dance2pose.detection import load_detector
from dance2pose.errors import ModelError, OutputError, UsageError
from dance2pose.onnx_models import downloading, registry
from dance2pose.onnx_models.recognition import inspect_model
from dance2pose.onnx_models.registry import RegisteredModel
from onnx_graphs import emitting

MANIFEST = {
    "kind": "detector",
    "input_width": 96,
    "input_height": 64,
    "colour_order": "BGR",
    "score_threshold": 0.25,
}


class Server(http.server.ThreadingHTTPServer):
    """Serves `files`; cuts: how many bytes of the body each coming answer sends at most."""

    files: dict[str, bytes]
    cuts: list[int]
    requests: list[tuple[str, str | None]]
    etags: bool

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(http.server.BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        asked = self.headers.get("Range")
        self.server.requests.append((self.path, asked))
        if self.path.startswith("/redirect?"):
            self.send_response(302)
            self.send_header("Location", self.path.removeprefix("/redirect?"))
            self.end_headers()
            return
        body = self.server.files.get(self.path)
        if body is None:
            self.send_error(404)
            return
        etag = f'"{hashlib.sha256(body).hexdigest()[:8]}"'
        start = 0
        if asked and self.headers.get("If-Range") == etag:
            start = int(asked.removeprefix("bytes=").removesuffix("-"))
            if start >= len(body):
                self.send_error(416)
                return
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(body) - start))
        if self.server.etags:
            self.send_header("ETag", etag)
        self.end_headers()
        most = self.server.cuts.pop(0) if self.server.cuts else len(body)
        self.wfile.write(body[start : start + most])

    def log_message(self, format: str, *args: object) -> None:
        del format, args


@pytest.fixture
def server() -> Iterator[Server]:
    instance = Server(("127.0.0.1", 0), Handler)
    instance.files, instance.cuts, instance.requests, instance.etags = {}, [], [], True
    thread = threading.Thread(target=instance.serve_forever, daemon=True)
    thread.start()
    yield instance
    instance.shutdown()
    instance.server_close()
    thread.join()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache" / "models"
    monkeypatch.setattr(registry, "cache_folder", lambda: folder)
    monkeypatch.setattr(downloading, "cache_folder", lambda: folder)
    monkeypatch.setattr(downloading, "PAUSE_S", 0.0)
    return folder


def onnx_bytes(tmp_path: Path, score: float = 0.9) -> bytes:
    dets = np.array([[[10, 10, 50, 60, score]]], np.float32)
    path = emitting(
        tmp_path / "source.onnx",
        {"dets": dets, "labels": np.zeros((1, 1), np.int64), "rtm_cls": np.zeros(1)},
        input_shape=[1, 3, 64, 96],
    )
    import onnx

    model = onnx.load(str(path))
    del model.graph.output[2]
    model.graph.initializer[2].CopyFrom(  # weight, so that the file is worth cutting
        onnx.numpy_helper.from_array(
            np.random.default_rng(0).normal(size=40_000), model.graph.initializer[2].name
        )
    )
    return bytes(model.SerializeToString())


def zip_bytes(*members: tuple[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return buffer.getvalue()


def entry(server: Server, path: str, **about: object) -> RegisteredModel:
    settings: dict[str, object] = {
        "name": "dancer",
        "description": "a detector",
        "url": server.address + path,
        "license": "Apache-2.0",
        "parameters_millions": 0.3,
        "manifest": MANIFEST,
        "archive_member": "end2end.onnx" if path.endswith(".zip") else None,
    }
    return RegisteredModel(**(settings | about))  # type: ignore[arg-type]


def left_in(folder: Path) -> set[str]:
    return {path.name for path in folder.rglob("*")} if folder.exists() else set()


WHOLE = {"dancer.onnx", "dancer.toml", "hashes.json"}


def test_a_model_of_a_zip_is_taken_by_name_and_works(
    server: Server, cache: Path, tmp_path: Path
) -> None:
    content = onnx_bytes(tmp_path)
    server.files["/m.zip"] = zip_bytes(
        ("20230831/deploy/pipeline.json", b"{}"), ("20230831/deploy/end2end.onnx", content)
    )
    pulled = downloading.pull(entry(server, "/m.zip"))
    assert pulled.path == cache / "dancer.onnx"
    assert pulled.path.read_bytes() == content
    assert pulled.sha256 == hashlib.sha256(content).hexdigest()
    assert pulled.first_download
    assert left_in(cache) == WHOLE
    detector = load_detector(pulled.path)
    assert detector.description.manifest.colour_order == "BGR"
    assert detector.description.manifest.score_threshold == 0.25
    assert detector.description.manifest.license == "Apache-2.0"
    assert detector.description.manifest.source == server.address + "/m.zip"


@pytest.mark.parametrize("cuts", [[1000], [1000, 50_000, 0, 0, 7], [1] * 9])
def test_a_cut_download_goes_on_where_it_stopped(
    cuts: list[int], server: Server, cache: Path, tmp_path: Path
) -> None:
    content = server.files["/m.onnx"] = onnx_bytes(tmp_path)
    server.cuts = list(cuts)
    pulled = downloading.pull(entry(server, "/m.onnx"))
    assert pulled.path.read_bytes() == content
    sums = np.cumsum([0, *cuts])
    expected = [f"bytes={had}-" if had else None for had in sums]
    assert [asked for _, asked in server.requests] == expected


def test_a_cut_download_goes_on_at_the_next_call(
    server: Server, cache: Path, tmp_path: Path
) -> None:
    content = server.files["/m.onnx"] = onnx_bytes(tmp_path)
    server.cuts = [20_000, *[0] * downloading.ATTEMPTS]
    with pytest.raises(ModelError, match=r"cut, 5 times; 20000 bytes are kept"):
        downloading.pull(entry(server, "/m.onnx"))
    assert not (cache / "dancer.onnx").exists()
    server.requests.clear()
    downloading.pull(entry(server, "/m.onnx"))
    assert server.requests == [("/m.onnx", "bytes=20000-")]
    assert (cache / "dancer.onnx").read_bytes() == content


@pytest.mark.parametrize("etags", [True, False])
def test_two_versions_are_never_joined(
    etags: bool, server: Server, cache: Path, tmp_path: Path
) -> None:
    server.etags = etags
    server.files["/m.onnx"] = onnx_bytes(tmp_path, score=0.5)
    server.cuts = [20_000, *[0] * downloading.ATTEMPTS]
    with pytest.raises(ModelError):
        downloading.pull(entry(server, "/m.onnx"))
    newer = server.files["/m.onnx"] = onnx_bytes(tmp_path, score=0.7)
    downloading.pull(entry(server, "/m.onnx"))
    assert (cache / "dancer.onnx").read_bytes() == newer


def test_a_known_hash_is_held_to(server: Server, cache: Path, tmp_path: Path) -> None:
    content = server.files["/m.onnx"] = onnx_bytes(tmp_path)
    with pytest.raises(ModelError, match=r"sha256 is [0-9a-f]{64}, expected 00ff"):
        downloading.pull(entry(server, "/m.onnx", sha256="00ff"))
    assert left_in(cache) == set()
    digest = hashlib.sha256(content).hexdigest()
    assert not downloading.pull(entry(server, "/m.onnx", sha256=digest)).first_download


def test_the_hash_of_the_first_download_is_held_to_ever_after(
    server: Server, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = server.files["/m.onnx"] = onnx_bytes(tmp_path, score=0.5)
    assert downloading.pull(entry(server, "/m.onnx")).first_download
    assert not downloading.pull(entry(server, "/m.onnx")).first_download
    server.files["/m.onnx"] = onnx_bytes(tmp_path, score=0.7)
    with pytest.raises(ModelError, match="the publisher changed it"):
        downloading.pull(entry(server, "/m.onnx"))
    assert (cache / "dancer.onnx").read_bytes() == first  # the good one stays
    assert left_in(cache) == WHOLE
    # By name, and checked at each use.
    monkeypatch.setattr(registry, "registry", lambda: {"dancer": entry(server, "/m.onnx")})
    assert inspect_model(Path("dancer")).path == cache / "dancer.onnx"
    damaged = bytearray(first)
    damaged[len(first) // 2] ^= 1
    (cache / "dancer.onnx").write_bytes(damaged)
    with pytest.raises(ModelError, match="has changed since it was downloaded"):
        inspect_model(Path("dancer"))


def test_a_name_that_is_not_pulled_yet(cache: Path) -> None:
    with pytest.raises(UsageError, match="dance2pose models pull rtmpose-m"):
        inspect_model(Path("rtmpose-m"))


@pytest.mark.parametrize(
    "name", ["../../escaped.onnx", "../end2end.onnx", "/end2end.onnx", "a\\..\\..\\x", "C:/x"]
)
def test_an_archive_that_reaches_outside_is_refused(
    name: str, server: Server, cache: Path, tmp_path: Path
) -> None:
    content = onnx_bytes(tmp_path)
    server.files["/m.zip"] = zip_bytes((name, content), ("end2end.onnx", content))
    before = {path for path in tmp_path.rglob("*") if cache not in path.parents}
    with pytest.raises(ModelError, match="names a file outside of itself"):
        downloading.pull(entry(server, "/m.zip"))
    after = {path for path in tmp_path.rglob("*") if cache not in path.parents}
    assert after - before <= {cache, cache.parent}
    assert not WHOLE & left_in(cache)


def damaged_zip(content: bytes) -> bytes:
    archive = bytearray(zip_bytes(("end2end.onnx", content)))
    archive[len(archive) // 2] ^= 255
    return bytes(archive)


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda content: content, "not a sound zip"),
        (lambda content: zip_bytes(("other.onnx", content)), "has 0 files called end2end.onnx"),
        (
            lambda content: zip_bytes(("a/end2end.onnx", content), ("b/end2end.onnx", content)),
            "has 2 files called",
        ),
        (damaged_zip, "not a sound zip"),
        (lambda content: zip_bytes(("end2end.onnx", b"hello")), "not an ONNX model"),
    ],
)
def test_archives_that_are_not_what_they_should_be(
    build: object, said: str, server: Server, cache: Path, tmp_path: Path
) -> None:
    server.files["/m.zip"] = build(onnx_bytes(tmp_path))  # type: ignore[operator]
    with pytest.raises(ModelError, match=said):
        downloading.pull(entry(server, "/m.zip"))
    assert not WHOLE & left_in(cache)


def test_an_archive_that_unpacks_to_too_much(
    server: Server, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.files["/m.zip"] = zip_bytes(("end2end.onnx", bytes(10_000_000)))
    monkeypatch.setattr(downloading, "LARGEST_MODEL_BYTES", 1_000_000)
    with pytest.raises(ModelError, match="too large"):
        downloading.pull(entry(server, "/m.zip"))
    server.files["/m.onnx"] = bytes(2_000_000)
    with pytest.raises(ModelError, match="more than any model"):
        downloading.pull(entry(server, "/m.onnx"))
    assert not WHOLE & left_in(cache)


def test_no_space(server: Server, cache: Path, tmp_path: Path) -> None:
    """A limit on the size of files is what a full disk is to the program."""
    server.files["/m.onnx"] = onnx_bytes(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    import signal

    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(OutputError, match="the disk is full; the download was thrown away"):
            downloading.pull(entry(server, "/m.onnx"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert left_in(cache) == set()


def test_addresses_that_are_not_asked(server: Server, cache: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret.onnx"
    secret.write_bytes(onnx_bytes(tmp_path))
    for url in (secret.as_uri(), "ftp://127.0.0.1/m.onnx", "http://example.org/m.onnx"):
        with pytest.raises(ModelError, match="only fetched over https"):
            downloading.pull(entry(server, "/m.onnx", url=url))
        redirected = f"{server.address}/redirect?{url}"
        with pytest.raises(ModelError):
            downloading.pull(entry(server, "/m.onnx", url=redirected))
    server.files["/m.onnx"] = secret.read_bytes()
    redirected = f"{server.address}/redirect?{server.address}/m.onnx"
    assert downloading.pull(entry(server, "/m.onnx", url=redirected)).path.is_file()


def test_not_there_and_nobody_there(server: Server, cache: Path) -> None:
    with pytest.raises(ModelError, match="answered 404"):
        downloading.pull(entry(server, "/missing.onnx"))
    assert len(server.requests) == 1
    with pytest.raises(ModelError, match=r"cannot be downloaded: .*refused"):
        downloading.pull(entry(server, "/m.onnx", url="http://127.0.0.1:9/m.onnx"))


def test_the_registry_is_sound() -> None:
    models = registry.registry()
    assert {"yolox-tiny", "yolox-m", "rtmpose-s", "rtmpose-m", "rtmpose-l", "rtmo-s"} <= set(models)
    assert {"rtmpose-m-halpe26"} <= set(models)
    for model in models.values():
        assert model.url.startswith("https://")
        assert model.license == "Apache-2.0"
        kind = model.manifest["kind"]
        assert ("skeleton" in model.manifest) == (kind != "detector")
        assert (model.archive_member is not None) == model.url.endswith(".zip")
    halpe = models["rtmpose-x-halpe26"].manifest
    assert (halpe["input_width"], halpe["input_height"]) == (288, 384)
    assert halpe["skeleton"] == "halpe26"


def test_command_line(tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "dance2pose", "models", *arguments],
            capture_output=True,
            text=True,
            timeout=120,
            env={"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "c"), "PATH": ""},
        )

    listed = run("list")
    assert listed.returncode == 0, listed.stderr
    assert "rtmpose-m-halpe26" in listed.stdout
    assert "detector: none" in listed.stdout
    assert not (tmp_path / "c").exists()  # listing makes nothing
    unknown = run("pull", "rtmpose-q")
    assert (unknown.returncode, unknown.stdout) == (2, "")
    assert "no model is called 'rtmpose-q'; did you mean 'rtmpose-" in unknown.stderr
    assert "known: yolox-nano" in unknown.stderr
