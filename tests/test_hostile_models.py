"""Models and servers made to hang, to fill the memory or to reach other files: one line each."""

from __future__ import annotations

import resource
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import helper

from dance2pose.detection import load_detector
from dance2pose.errors import ModelError
from dance2pose.onnx_models import downloading, registry, run_limits
from dance2pose.onnx_models.downloading import pull
from dance2pose.onnx_models.recognition import inspect_model
from dance2pose.onnx_models.registry import RegisteredModel
from onnx_graphs import allocating, emitting, save, tensor, with_external_data

DETS = {"dets": np.zeros((1, 2, 5), np.float32), "labels": np.zeros((1, 2), np.int64)}


def endless(path: Path, *, on_white_only: bool = False) -> Path:
    """A detector whose answer is a loop without an end, over the probe's grey picture or only
    where the picture is white."""
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["go"], ["go_on"]),
            helper.make_node("Mul", ["v", "v"], ["w"]),
        ],
        "body",
        [tensor("i", np.int64, []), tensor("go", np.bool_, []), tensor("v", np.float32, [1, 2, 5])],
        [tensor("go_on", np.bool_, []), tensor("w", np.float32, [1, 2, 5])],
    )  # fmt: skip
    nodes = [
        helper.make_node("ReduceMax", ["images"], ["most"], keepdims=0),
        helper.make_node("Greater", ["most", "limit"], ["goes"]),
        helper.make_node("Loop", ["", "goes", "start"], ["dets"], body=body),
        helper.make_node("Identity", ["none"], ["labels"]),
    ]
    constants = {
        "limit": np.array(2.0 if on_white_only else -1e9, np.float32),
        "start": np.zeros((1, 2, 5), np.float32),
        "none": np.zeros((1, 2), np.int64),
    }
    outputs = [tensor("dets", np.float32, [1, 2, 5]), tensor("labels", np.int64, [1, 2])]
    return save(path, nodes, [tensor("images", np.float32, [1, 3, 64, 96])], outputs, constants)


def test_a_loop_without_an_end_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_limits, "LONGEST_RUN_S", 0.5)
    with pytest.raises(ModelError, match=r"m\.onnx: the model failed: it was stopped after 0\.5 s"):
        load_detector(endless(tmp_path / "m.onnx"))


def test_a_loop_that_only_some_pictures_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_limits, "LONGEST_RUN_S", 0.5)
    detector = load_detector(endless(tmp_path / "m.onnx", on_white_only=True))
    assert len(detector.detect(np.zeros((50, 70, 3), np.uint8))) == 0
    with pytest.raises(ModelError, match="it was stopped after"):
        detector.detect(np.full((50, 70, 3), 255, np.uint8))
    assert len(detector.detect(np.zeros((50, 70, 3), np.uint8))) == 0


def test_runs_in_time_are_not_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_limits, "LONGEST_RUN_S", 30.0)
    detector = load_detector(emitting(tmp_path / "m.onnx", DETS, input_shape=[1, 3, 64, 96]))
    for _ in range(200):
        detector.detect(np.zeros((50, 70, 3), np.uint8))
    assert not run_limits._watch._deadlines


@given(st.integers(8, 10**9))
@settings(max_examples=10, deadline=None)
def test_memory_beyond_the_limit_is_refused_whatever_is_asked_for(gibibytes: int) -> None:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(ModelError, match=r"more memory than|m\.onnx: "):
            load_detector(allocating(Path(folder) / "m.onnx", gibibytes))
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 2 * 1024**2  # kilobytes


def external(path: Path, location: str) -> Path:
    """A model whose weights are said to lie at `location`."""
    with_external_data(path)
    model = onnx.load(str(path), load_external_data=False)
    for weights in model.graph.initializer:
        for entry in weights.external_data:
            if entry.key == "location":
                entry.value = location
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize(
    "location", ["../secret.bin", "/etc/hostname", "/dev/zero", "a/../../secret.bin"]
)
def test_weights_outside_of_the_models_folder_are_not_read(location: str, tmp_path: Path) -> None:
    folder = tmp_path / "models"
    (folder / "a").mkdir(parents=True)
    (tmp_path / "secret.bin").write_bytes(bytes(100_000))
    with pytest.raises(ModelError, match=r"m\.onnx: .*(outside of its own folder|separate file)"):
        inspect_model(external(folder / "m.onnx", location))


def test_a_link_that_leads_outside_is_not_followed(tmp_path: Path) -> None:
    folder = tmp_path / "models"
    folder.mkdir()
    path = external(folder / "m.onnx", "weights.bin")
    (folder / "weights.bin").symlink_to(folder / "m.onnx.data")
    assert inspect_model(path).form == "heatmap"
    (tmp_path / "elsewhere.bin").write_bytes((folder / "m.onnx.data").read_bytes())
    (folder / "weights.bin").unlink()
    (folder / "weights.bin").symlink_to(tmp_path / "elsewhere.bin")
    with pytest.raises(ModelError, match=r"m\.onnx: .*(outside of its own folder|separate file)"):
        inspect_model(path)


@pytest.mark.parametrize("where", ["initializer", "input"])
def test_shapes_of_a_trillion_are_refused(where: str, tmp_path: Path) -> None:
    path = emitting(tmp_path / "m.onnx", DETS, input_shape=[1, 3, 64, 96])
    model = onnx.load(str(path))
    if where == "initializer":
        weights = model.graph.initializer[0]
        del weights.dims[:]
        weights.dims.extend([10**6, 10**6])
    else:
        for dimension in model.graph.input[0].type.tensor_type.shape.dim[-2:]:
            dimension.dim_value = 10**6
    path.write_bytes(model.SerializeToString())
    with pytest.raises(ModelError, match=r"m\.onnx: ") as refused:
        inspect_model(path)
    assert "\n" not in str(refused.value)


# Servers ----------------------------------------------------------------------------------------


@pytest.fixture
def served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Callable[[socket.socket], None]], str]]:
    """Give an address at which `behave` answers every connection; the limits are made short."""
    folder = tmp_path / "cache"
    for module in (registry, downloading):
        monkeypatch.setattr(module, "cache_folder", lambda: folder)
    for name, value in {"PAUSE_S": 0.0, "ANSWER_S": 0.3, "WINDOW_S": 0.3, "ATTEMPTS": 2}.items():
        monkeypatch.setattr(downloading, name, value)
    listener = socket.create_server(("127.0.0.1", 0))
    over = threading.Event()

    def give(behave: Callable[[socket.socket], None]) -> str:
        def talk(connection: socket.socket) -> None:
            try:
                connection.recv(65536)
                while not over.is_set():
                    behave(connection)
                    over.wait(0.02)
            except OSError:
                pass  # the client has left

        def serve() -> None:
            while not over.is_set():
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                threading.Thread(target=talk, args=(connection,), daemon=True).start()

        threading.Thread(target=serve, daemon=True).start()
        return f"http://127.0.0.1:{listener.getsockname()[1]}/m.onnx"

    yield give
    over.set()
    listener.close()


def model_at(url: str) -> RegisteredModel:
    manifest: dict[str, Any] = {"kind": "detector", "input_width": 96, "input_height": 64}
    return RegisteredModel("dancer", "a detector", url, "MIT", 0.3, manifest)


def test_a_server_that_never_ends_its_header(served: Callable[..., str]) -> None:
    url = served(lambda connection: connection.sendall(b"H"))
    with pytest.raises(ModelError, match=r"cannot be downloaded: the server had not answered"):
        pull(model_at(url))


def test_a_server_that_drips_its_answer(served: Callable[..., str]) -> None:
    begun: set[int] = set()

    def drip(connection: socket.socket) -> None:
        if id(connection) not in begun:
            begun.add(id(connection))
            connection.sendall(b"HTTP/1.1 200 OK\r\nETag: x\r\n\r\n")
        connection.sendall(b"x")

    with pytest.raises(ModelError, match=r"cannot be downloaded: the server sent \d+ bytes in 0.3"):
        pull(model_at(served(drip)))


@pytest.mark.parametrize(
    "target", ["file:///etc/passwd", "ftp://127.0.0.1/x", "http://example.com/"]
)
def test_a_server_that_leads_elsewhere(target: str, served: Callable[..., str]) -> None:
    answer = f"HTTP/1.1 302 Found\r\nLocation: {target}\r\nContent-Length: 0\r\n\r\n".encode()
    with pytest.raises(ModelError, match=r"models are only fetched over https|is not allowed"):
        pull(model_at(served(lambda connection: connection.sendall(answer))))


def test_a_server_that_leads_in_circles(served: Callable[..., str]) -> None:
    answer = b"HTTP/1.1 302 Found\r\nLocation: /m.onnx\r\nContent-Length: 0\r\n\r\n"
    with pytest.raises(ModelError, match=r"the server answered 302|cannot be downloaded"):
        pull(model_at(served(lambda connection: connection.sendall(answer))))


def test_a_zip_whose_list_is_too_long_is_refused_before_it_is_read(tmp_path: Path) -> None:
    archive = tmp_path / "a.zip"
    end = b"PK\5\6" + bytes(8) + (10**9).to_bytes(4, "little") + bytes(6)
    archive.write_bytes(bytes(1000) + end)
    with pytest.raises(ModelError, match="list of files has 1000000000 bytes, too many"):
        downloading._take_member(archive, "m.onnx", tmp_path / "m.onnx", "https://x/a.zip")


def test_the_watch_does_not_keep_a_program_alive(tmp_path: Path) -> None:
    path = emitting(tmp_path / "m.onnx", DETS, input_shape=[1, 3, 64, 96])
    code = f"from dance2pose.detection import load_detector; load_detector({str(path)!r})"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
