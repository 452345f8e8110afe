"""How fast the whole chain is, beside its models alone and beside rtmlib, and what memory it takes.

    python scripts/bench_pipeline.py VIDEO --detector D.onnx --pose P.onnx [--minutes 1 30]

Everything runs on the same video with the same two models, in turns, and the best turn of each
counts (other work on the machine only ever slows a turn down). For rtmlib a virtual environment of
its own is made in a temporary folder: it brings opencv-python, which does not go with
opencv-python-headless. rtmlib reads YOLOX (raw) and RTMPose (SimCC) models.

- chain: `reconstruct`, from the video file to the finished recording, models loaded anew.
- session: only the `session.run` calls of the detector and the pose model, on the same inputs.
- rtmlib: its YOLOX and RTMPose over the frames of cv2.VideoCapture; no tracks, no 3D, no output.

Keypoints are compared with both sides fed alike: rtmlib feeds BGR pictures normalised with RGB
statistics, so here, and only here, the pose model is fed BGR too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
import onnxruntime

from dance2pose.detection import load_detector
from dance2pose.keypoints import KeypointEstimator, load_pose_model
from dance2pose.onnx_models.inference import Session
from dance2pose.options import Settings
from dance2pose.poses import Poses2D
from dance2pose.reconstruction import reconstruct
from dance2pose.video import open_video

TARGET_OF_SESSION, TARGET_OF_RTMLIB, TARGET_PX = 0.85, 1.3, 2.0
CONFIDENT = 0.3


@dataclass(frozen=True)
class Turn:
    """One measured turn. wall_s, cpu_s: of `frames` frames; cpu_s counts all threads."""

    frames: int
    wall_s: float
    cpu_s: float

    @property
    def rate(self) -> float:
        return self.frames / self.wall_s

    def __str__(self) -> str:
        cpu_ms = 1e3 * self.cpu_s / self.frames
        return f"{self.rate:7.2f} frames/s, {cpu_ms:6.1f} ms of processor time a frame"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("video", type=Path)
    parser.add_argument("--detector", type=Path, required=True)
    parser.add_argument("--pose", type=Path, required=True)
    parser.add_argument("--lifter", choices=["default", "paper"], default="default")
    parser.add_argument("--seconds", type=float, help="of the video to use, all if not given")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--minutes", type=float, nargs="*", default=[], help="of memory runs")
    parser.add_argument("--no-rtmlib", action="store_true")
    options = parser.parse_args()
    print(f"{options.video.name}, {options.detector.name}, {options.pose.name}")
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, ORT {onnxruntime.__version__}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        measure_speed(options, folder)
        for minutes in options.minutes:
            peak, turn = measure_memory(options, folder, minutes)
            print(f"{minutes:g} min of video: peak memory {peak / 1e6:.0f} MB, {turn}")


def measure_speed(options: argparse.Namespace, folder: Path) -> None:
    settings = Settings.of(
        detector=options.detector, pose=options.pose, lifter=options.lifter, end_s=options.seconds
    )
    models = Models(options.detector, options.pose)
    turns: dict[str, Callable[[], Turn]] = {
        "chain": lambda: chain(options.video, settings, folder / "out.rrd"),
        "session": lambda: models.session_alone(options.video, options.seconds),
    }
    if not options.no_rtmlib:
        python = environment_with_rtmlib(folder)
        turns["rtmlib"] = lambda: rtmlib(python, options, models, folder)
    results: dict[str, list[Turn]] = {name: [] for name in turns}
    for _ in range(options.turns):
        for name, turn in turns.items():
            results[name].append(turn())
            print(f"  {name:8} {results[name][-1]}", flush=True)
    best = {name: max(done, key=lambda turn: turn.rate) for name, done in results.items()}
    least = {name: min(turn.cpu_s / turn.frames for turn in done) for name, done in results.items()}
    print("best of each:")
    for name, fastest in best.items():
        print(f"{name:8} {fastest}")
    compare("session", TARGET_OF_SESSION, best, least)
    if "rtmlib" in best:
        compare("rtmlib", TARGET_OF_RTMLIB, best, least)
        print_distance(options, folder)


def compare(other: str, target: float, best: dict[str, Turn], least: dict[str, float]) -> None:
    ratio = best["chain"].rate / best[other].rate
    by_cpu = least[other] / least["chain"]
    verdict = "reached" if ratio >= target else "missed"
    print(
        f"chain / {other}: {ratio:.2f} (target {target}, {verdict}); by processor time {by_cpu:.2f}"
    )


def chain(video: Path, settings: Settings, output: Path) -> Turn:
    wall, cpu = time.perf_counter(), time.process_time()
    summary = reconstruct(video, output, settings, overwrite=True)
    return Turn(summary.frames, time.perf_counter() - wall, time.process_time() - cpu)


class Models:
    """The two models, with their `session.run` calls timed."""

    def __init__(self, detector: Path, pose: Path, manifest: Path | None = None) -> None:
        self.detector = load_detector(detector)
        estimator = load_pose_model(pose, manifest=manifest)
        if not isinstance(estimator, KeypointEstimator):
            raise SystemExit(f"{pose}: is a one-stage model; rtmlib is compared with two models")
        self.estimator = estimator
        self.wall_s = self.cpu_s = 0.0
        for model in (self.detector, self.estimator):
            session: Session = vars(model)["_session"]
            session._native = _Timed(session._native, self)

    def session_alone(self, video: Path, seconds: float | None) -> Turn:
        """The time spent inside `session.run` while the video goes through both models."""
        self.wall_s = self.cpu_s = 0.0
        frames = 0
        with open_video(video, end_s=seconds) as reader:
            # Decoded beforehand: nothing but the models shall use the processor meanwhile.
            pictures = [frame.image for frame in reader]
        for picture in pictures:
            self.estimator.estimate(picture, self.detector.detect(picture))
            frames += 1
        return Turn(frames, self.wall_s, self.cpu_s)


class _Timed:
    """An ONNX Runtime session that adds up how long its `run` takes."""

    def __init__(self, native: Any, total: Models) -> None:
        self._native, self._total = native, total

    def run(self, *arguments: Any) -> Any:
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            return self._native.run(*arguments)
        finally:
            self._total.wall_s += time.perf_counter() - wall
            self._total.cpu_s += time.process_time() - cpu


# rtmlib ---------------------------------------------------------------------------------------


def environment_with_rtmlib(folder: Path) -> Path:
    """Python of a new virtual environment with rtmlib and the same ONNX Runtime."""
    target = folder / "rtmlib"
    venv.create(target, with_pip=True)
    python = target / ("Scripts" if os.name == "nt" else "bin") / "python"
    packages = ["rtmlib", f"onnxruntime=={onnxruntime.__version__}", f"numpy=={np.__version__}"]
    subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
    return python


def rtmlib(python: Path, options: argparse.Namespace, models: Models, folder: Path) -> Turn:
    detector = models.detector.description.manifest
    pose = models.estimator.description.manifest
    job = {
        "video": str(options.video),
        "seconds": options.seconds,
        "detector": str(models.detector.description.path),
        "detector_size": [detector.input_height, detector.input_width],
        "score_threshold": detector.score_threshold,
        "nms_threshold": detector.nms_threshold,
        "pose": str(models.estimator.description.path),
        "pose_size": [pose.input_width, pose.input_height],
        "output": str(folder / "rtmlib.json"),
    }
    script = Path(__file__).with_name("bench_rtmlib.py")
    subprocess.run([python, script, json.dumps(job)], check=True, stdout=subprocess.DEVNULL)
    answer = json.loads((folder / "rtmlib.json").read_text())
    return Turn(len(answer["poses"]), answer["wall_s"], answer["cpu_s"])


def print_distance(options: argparse.Namespace, folder: Path) -> None:
    """Mean distance between our keypoints and rtmlib's, of the same person in the same frame."""
    manifest = folder / "bgr.toml"
    manifest.write_text('colour_order = "BGR"\n')
    models = Models(options.detector, options.pose, manifest)
    theirs = json.loads((folder / "rtmlib.json").read_text())["poses"]
    distances: list[float] = []
    alone = people = 0
    with open_video(options.video, end_s=options.seconds) as reader:
        for frame, other in zip(reader, theirs, strict=False):
            ours = models.estimator.estimate(frame.image, models.detector.detect(frame.image))
            people += len(ours)
            matched = distances_of_a_frame(ours, np.array(other).reshape(-1, *ours.xy.shape[1:]))
            alone += len(ours) - len(matched)
            distances += [d for person in matched for d in person]
    mean = float(np.mean(distances))
    verdict = "reached" if mean <= TARGET_PX else "missed"
    print(
        f"keypoints against rtmlib's: {mean:.2f} px on average (target {TARGET_PX}, {verdict}), "
        f"median {np.median(distances):.2f}, 95 % below {np.quantile(distances, 0.95):.2f}; "
        f"{len(distances)} keypoints, {alone} of {people} people seen by one side only"
    )


def distances_of_a_frame(ours: Poses2D, theirs: np.ndarray[Any, Any]) -> list[list[float]]:
    """Distances (px) of the confident keypoints of every person that both sides see."""
    out = []
    for xy, confidence in zip(ours.xy, ours.confidence, strict=True):
        if not len(theirs):
            break
        apart = np.linalg.norm(theirs - xy, axis=2)
        nearest = apart[np.argmin(np.nanmedian(apart, axis=1))]
        extent = float(np.ptp(xy[np.isfinite(xy).all(axis=1)], axis=0).max())
        if np.nanmedian(nearest) < extent / 4:  # else it is another person
            out.append(nearest[confidence > CONFIDENT].tolist())
    return out


# Memory ---------------------------------------------------------------------------------------


def measure_memory(options: argparse.Namespace, folder: Path, minutes: float) -> tuple[int, Turn]:
    """Peak resident memory (bytes) of `dance2pose` on the clip repeated to that length."""
    clip = looped(options.video, folder / f"loop_{minutes:g}.mkv", minutes * 60)
    command = [
        *(sys.executable, "-m", "dance2pose", str(clip), "-o", str(folder / "loop.rrd")),
        *("--detector", str(options.detector), "--pose", str(options.pose)),
        *("--lifter", options.lifter, "--picture", "none", "--overwrite", "--quiet"),
    ]
    start = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"the run over {minutes:g} minutes failed")
    with av.open(str(clip)) as container:
        frames = sum(1 for packet in container.demux(video=0) if packet.size)
    kilo = 1 if sys.platform == "darwin" else 1024
    cpu = usage.ru_utime + usage.ru_stime
    return usage.ru_maxrss * kilo, Turn(frames, time.perf_counter() - start, cpu)


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
