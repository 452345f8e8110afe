"""Memory and size of the recording over a long video, with models that only pretend.

    python scripts/bench_memory.py VIDEO [--minutes 60] [--picture video] [--people 2]

VIDEO is repeated (its packets copied) to the length, and `dance2pose` runs over it in a process
of its own with STUB models: tiny ONNX graphs that see the same people in the same pose in every
frame. Everything else is real, so memory is that of any models of their size less; real models
would take hours. Prints resident memory minute by minute of wall time, its peak, whether the
recording verifies, and its size beside the video's.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import av
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

TARGET_PEAK_MB, TARGET_RATIO, TARGET_MORE_MB = 700, 1.05, 200
WIDTH, HEIGHT = 192, 256
# A person standing with the arms out, COCO order, in shares of the box.
POSE = np.array(
    [
        *([0.50, 0.10], [0.53, 0.08], [0.47, 0.08], [0.56, 0.09], [0.44, 0.09]),
        *([0.62, 0.22], [0.38, 0.22], [0.74, 0.30], [0.26, 0.30], [0.86, 0.36], [0.14, 0.36]),
        *([0.57, 0.52], [0.43, 0.52], [0.58, 0.72], [0.42, 0.72], [0.59, 0.93], [0.41, 0.93]),
    ]
)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("video", type=Path)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--picture", choices=["auto", "video", "frames", "none"], default="video")
    parser.add_argument("--people", type=int, default=2)
    parser.add_argument("--every-s", type=float, default=30, help="seconds between two looks")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip = looped(options.video, folder / "loop.mp4", options.minutes * 60)
        out = folder / "loop.rrd"
        command = [
            *(sys.executable, "-m", "dance2pose", str(clip), "-o", str(out)),
            *("--detector", str(stub_detector(folder, options.people))),
            *("--pose", str(stub_pose(folder)), "--picture", options.picture),
            *("--person", "all", "--profile", "--quiet"),
        ]
        start = time.perf_counter()
        process = subprocess.Popen(command)
        seen = watch(process, options.every_s)
        print(f"{options.minutes:g} min of video in {(time.perf_counter() - start) / 60:.1f} min")
        if process.returncode:
            raise SystemExit(f"the run failed with status {process.returncode}")
        report(seen, clip, out)


def watch(process: subprocess.Popen[bytes], every_s: float) -> list[tuple[float, float]]:
    """Seconds since the start and resident megabytes, until the process ends; the last is the
    peak that the system saw."""
    start = time.perf_counter()
    seen: list[tuple[float, float]] = []
    peak = 0.0
    next_print = 0.0
    while process.poll() is None:
        status = Path(f"/proc/{process.pid}/status").read_text()
        fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
        if "VmRSS" in fields:
            now = time.perf_counter() - start
            seen.append((now, int(fields["VmRSS"].split()[0]) / 1e3))
            peak = max(peak, int(fields["VmHWM"].split()[0]) / 1e3)
            if now >= next_print:
                print(f"  {now:7.0f} s {seen[-1][1]:7.0f} MB (peak {peak:.0f})", flush=True)
                next_print += every_s
        time.sleep(0.5)
    seen.append((time.perf_counter() - start, peak))
    return seen


def report(seen: list[tuple[float, float]], clip: Path, out: Path) -> None:
    peak = seen[-1][1]
    first = max((mb for s, mb in seen[:-1] if s <= 60), default=peak)
    print(f"peak {peak:.0f} MB (target {TARGET_PEAK_MB}, {verdict(peak <= TARGET_PEAK_MB)});")
    print(f"in the first minute of the run at most {first:.0f} MB")
    video, recording = clip.stat().st_size / 1e6, out.stat().st_size / 1e6
    most = TARGET_RATIO * video + TARGET_MORE_MB
    print(
        f"recording {recording:.0f} MB, video {video:.0f} MB "
        f"(at most {most:.0f}, {verdict(recording <= most)})"
    )
    check = subprocess.run([sys.executable, "-m", "rerun_cli", "rrd", "verify", str(out)])
    print(f"rerun rrd verify: {'good' if check.returncode == 0 else 'FAILED'}")


def verdict(reached: bool) -> str:
    return "reached" if reached else "missed"


def stub_detector(folder: Path, people: int) -> Path:
    """People side by side, in every picture."""
    left = np.linspace(20, 160, people)
    boxes = np.stack([left, np.full(people, 40), left + 80, np.full(people, 175)], axis=1)
    dets = np.concatenate([boxes, np.full((people, 1), 0.9)], axis=1)[np.newaxis]
    labels = np.zeros((1, people), np.int64)
    values: dict[str, np.ndarray] = {"dets": dets.astype(np.float32), "labels": labels}
    return constant_graph(folder / "STUB_detector.onnx", values, (1, 3, 320, 320))


def stub_pose(folder: Path) -> Path:
    """One pose, in the form of RTMPose's SimCC."""
    x, y = np.zeros((1, 17, 2 * WIDTH), np.float32), np.zeros((1, 17, 2 * HEIGHT), np.float32)
    columns = (POSE * (2 * WIDTH, 2 * HEIGHT)).astype(int)
    x[0, np.arange(17), columns[:, 0]] = y[0, np.arange(17), columns[:, 1]] = 0.9
    values = {"simcc_x": x, "simcc_y": y}
    return constant_graph(folder / "STUB_pose.onnx", values, (1, 3, HEIGHT, WIDTH))


def constant_graph(path: Path, values: dict[str, np.ndarray], input_shape: tuple[int, ...]) -> Path:
    graph = helper.make_graph(
        [helper.make_node("Identity", [f"{name}_value"], [name]) for name in values],
        "stub",
        [helper.make_tensor_value_info("input", TensorProto.FLOAT, input_shape)],
        [
            helper.make_tensor_value_info(
                name, helper.np_dtype_to_tensor_dtype(value.dtype), value.shape
            )
            for name, value in values.items()
        ],
        [numpy_helper.from_array(value, f"{name}_value") for name, value in values.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 9
    onnx.save(model, str(path))
    return path


def looped(video: Path, target: Path, seconds: float) -> Path:
    """The clip again and again, its packets copied, with times that go on."""
    with av.open(str(target), "w") as output:
        stream = None
        shift = 0.0
        while shift < seconds:
            with av.open(str(video)) as source:
                original = source.streams.video[0]
                stream = stream or output.add_stream_from_template(original)
                base = float(original.time_base or 0)
                end = 0.0
                for packet in source.demux(original):
                    if packet.pts is None or packet.dts is None:
                        continue
                    end = max(end, (packet.pts + (packet.duration or 0)) * base)
                    packet.pts += round(shift / base)
                    packet.dts += round(shift / base)
                    packet.stream = stream
                    output.mux(packet)
                shift += end
    return target


if __name__ == "__main__":
    main()
