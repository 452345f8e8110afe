"""How fast the whole chain is, beside its models alone and beside rtmlib in both arrangements.

    python scripts/bench_pipeline.py VIDEO --detector D.onnx --pose P.onnx [--turns 5] [--cores 1]

Everything runs on the same video with the same two model files, in turns, so that other work on
the machine meets all alike. A ratio is taken within each turn; the median over the turns counts.
For rtmlib a virtual environment of its own is made in a temporary folder (or named with
--rtmlib-python): it brings opencv-python, which does not go with opencv-python-headless. rtmlib
reads YOLOX (raw) and RTMPose (SimCC) models.

- chain: `reconstruct`, from the video file to the finished recording, models loaded anew.
- chain 1: the same with the detector on every frame.
- bound: only the `session.run` calls that the chain needed, spread over as many threads as there
  are cores, on inputs made beforehand: the chain cannot be faster.
- alone: the same if calls side by side did not slow each other (memory, caches): a part of them,
  one after the other in one thread, their time divided by the cores.
- rtmlib 10, rtmlib 1: its PoseTracker over the frames of cv2.VideoCapture, with the detector on
  every tenth or on every frame; no tracks, no 3D, no output.

Keypoints are compared with both sides fed alike: rtmlib feeds BGR pictures normalised with RGB
statistics, so here, and only here, the pose model is fed BGR too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
import venv
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from dance2pose.detection import load_detector
from dance2pose.keypoints import KeypointEstimator, load_pose_model
from dance2pose.onnx_models.inference import Session, usable_cores
from dance2pose.options import OutputOptions, Settings, SpeedOptions
from dance2pose.people import PoseModels, find_people
from dance2pose.profiling import Profile
from dance2pose.reconstruction import reconstruct
from dance2pose.video import open_video

# Least ratios of the chain's frame rate, and the largest mean distance of keypoints.
TARGETS = {"bound": 0.85, "rtmlib 10": 2.5}
TARGET_PX = 2.0
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
    parser.add_argument("--detect-every", type=int, default=SpeedOptions.detect_every)
    parser.add_argument("--seconds", type=float, help="of the video to use, all if not given")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--cores", type=int, help="to use, by affinity, without rtmlib")
    parser.add_argument("--rtmlib-python", type=Path, help="of an environment that has rtmlib")
    parser.add_argument("--no-rtmlib", action="store_true")
    options = parser.parse_args()
    if options.cores:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
        options.no_rtmlib = True  # its ONNX Runtime binds threads to all cores, whatever we say
    print(f"{options.video.name}, {options.detector.name}, {options.pose.name}")
    print(f"{usable_cores()} cores, load {os.getloadavg()[0]:.1f}, ORT {onnxruntime.__version__}")
    with tempfile.TemporaryDirectory() as name:
        measure(options, Path(name))


def measure(options: argparse.Namespace, folder: Path) -> None:
    bench = Bench(options, folder)
    turns: dict[str, Callable[[], Turn]] = {
        "chain": lambda: bench.chain(options.detect_every),
        "bound": bench.bound,
        "alone": bench.alone,
        "chain 1": lambda: bench.chain(1),
    }
    if not options.no_rtmlib:
        python = options.rtmlib_python or environment_with_rtmlib(folder)
        turns["rtmlib 10"] = lambda: bench.rtmlib(python, 10)
        turns["rtmlib 1"] = lambda: bench.rtmlib(python, 1)
    results: dict[str, list[Turn]] = {name: [] for name in turns}
    for _ in range(options.turns):
        for name, turn in turns.items():
            results[name].append(turn())
            print(f"  {name:9} {results[name][-1]}", flush=True)
    print("frames a second, median of the turns, and the chain's ratio to it:")
    rates = {name: np.array([turn.rate for turn in done]) for name, done in results.items()}
    for name, rate in rates.items():
        ratio = float(np.median(rates["chain"] / rate))
        target = TARGETS.get(name)
        verdict = f" (target {target}, {reached(ratio >= target)})" if target else ""
        print(f"{name:9} {np.median(rate):7.2f}  {ratio:5.2f}{verdict}")
    after = bench.profile.share("lifting", "smoothing", "recording")
    print(f"lifting and writing: {after:.1%} of the chain (target 5 %, {reached(after <= 0.05)})")
    print(bench.profile.table())
    if not options.no_rtmlib:
        bench.print_distance()


def reached(holds: bool) -> str:
    return "reached" if holds else "missed"


class Bench:
    """What is measured, on one video with two models."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.options = options
        self.folder = folder
        self.detector = load_detector(options.detector, threads=1)
        estimator = load_pose_model(options.pose, threads=1)
        if not isinstance(estimator, KeypointEstimator):
            raise SystemExit(f"{options.pose}: is a one-stage model; rtmlib runs two models")
        self.estimator = estimator
        self.profile = Profile()

    def chain(self, detect_every: int) -> Turn:
        settings = Settings.of(
            detector=self.options.detector,
            pose=self.options.pose,
            end_s=self.options.seconds,
            detect_every=detect_every,
        )
        wall, cpu = time.perf_counter(), time.process_time()
        with Profile() as profile:
            summary = reconstruct(
                self.options.video,
                self.folder / "out.rrd",
                settings,
                outputs=OutputOptions(picture="none"),
                overwrite=True,
            )
        if detect_every == self.options.detect_every:
            self.profile, self.frames = profile, summary.frames
        return Turn(summary.frames, time.perf_counter() - wall, time.process_time() - cpu)

    def calls(self) -> list[Callable[[], Any]]:
        """The model calls of the last chain."""
        jobs = []
        for name, model in (("keypoints", self.estimator), ("detector", self.detector)):
            session: Session = vars(model)["session"]
            jobs += [model_call(session)] * self.profile.calls[name]
        return jobs

    def alone(self) -> Turn:
        """Every fourth of the model calls, one after the other in one thread."""
        jobs = self.calls()
        wall, cpu = time.perf_counter(), time.process_time()
        for job in jobs[::4]:
            job()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        part = len(jobs[::4]) / len(jobs)
        return Turn(self.frames, wall / part / usable_cores(), cpu / part)

    def bound(self) -> Turn:
        """The model calls of the last chain, and nothing else, in one thread a core."""
        jobs = self.calls()
        wall, cpu = time.perf_counter(), time.process_time()
        with ThreadPoolExecutor(usable_cores()) as pool:
            for done in [pool.submit(job) for job in jobs]:
                done.result()
        return Turn(self.frames, time.perf_counter() - wall, time.process_time() - cpu)

    def rtmlib(self, python: Path, detect_every: int) -> Turn:
        detector = self.detector.description.manifest
        pose = self.estimator.description.manifest
        output = self.folder / f"rtmlib_{detect_every}.json"
        job = {
            "video": str(self.options.video),
            "seconds": self.options.seconds,
            "detect_every": detect_every,
            "detector": str(self.detector.description.path),
            "detector_size": [detector.input_height, detector.input_width],
            "score_threshold": detector.score_threshold,
            "nms_threshold": detector.nms_threshold,
            "pose": str(self.estimator.description.path),
            "pose_size": [pose.input_width, pose.input_height],
            "output": str(output),
        }
        script = Path(__file__).with_name("bench_rtmlib.py")
        subprocess.run([python, script, json.dumps(job)], check=True, stdout=subprocess.DEVNULL)
        answer = json.loads(output.read_text())
        return Turn(len(answer["poses"]), answer["wall_s"], answer["cpu_s"])

    def print_distance(self) -> None:
        """Mean distance between the chain's keypoints and those of rtmlib's detector on every
        frame, of the same person in the same frame."""
        manifest = self.folder / "bgr.toml"
        manifest.write_text('colour_order = "BGR"\n')
        pose = load_pose_model(self.options.pose, manifest=manifest, threads=1)
        models = PoseModels(self.detector, pose)
        speed = SpeedOptions(detect_every=self.options.detect_every)
        theirs, faster = (
            json.loads((self.folder / f"rtmlib_{every}.json").read_text())["poses"]
            for every in (1, 10)
        )
        distances: list[float] = []
        all_ours: list[float] = []
        all_theirs: list[float] = []
        alone = people = 0
        with open_video(self.options.video, end_s=self.options.seconds) as reader:
            found = find_people(reader, models, speed)
            for ours, poses, poses_10 in zip(
                (f.poses for f in found), theirs, faster, strict=False
            ):
                joints = ours.xy.shape[1:]
                other = np.array(poses).reshape(-1, *joints)
                sure = ours.confidence > CONFIDENT
                matched = distances_of_a_frame(ours.xy, sure, other)
                people += len(ours)
                alone += len(ours) - len(matched)
                distances += [d for person in matched for d in person]
                for xy, into in ((ours.xy, all_ours), (poses_10, all_theirs)):
                    xy = np.array(xy).reshape(-1, *joints)
                    each = distances_of_a_frame(xy, np.ones(xy.shape[:2], bool), other)
                    into += [d for person in each for d in person]
        mean = float(np.mean(distances))
        print(
            f"keypoints against rtmlib's, detector on every frame: {mean:.2f} px on average "
            f"(target {TARGET_PX}, {reached(mean <= TARGET_PX)}), median "
            f"{np.median(distances):.2f}, 95 % below {np.quantile(distances, 0.95):.2f}; "
            f"{len(distances)} keypoints, {alone} of {people} people seen by one side only"
        )
        print(
            f"unsure keypoints as well: {np.mean(all_ours):.2f} px; for comparison, rtmlib's two "
            f"arrangements are {np.mean(all_theirs):.2f} px apart"
        )


def model_call(session: Session) -> Callable[[], Any]:
    """One run of a model on an input made beforehand."""
    random = np.random.default_rng(0)
    feeds = {
        tensor.name: random.uniform(0, 1, [n or 1 for n in tensor.shape]).astype(tensor.dtype)
        for tensor in session.inputs
    }
    outputs = [tensor.name for tensor in session.outputs]
    return lambda: session._native.run(outputs, feeds)


def environment_with_rtmlib(folder: Path) -> Path:
    """Python of a new virtual environment with rtmlib and the same ONNX Runtime."""
    target = folder / "rtmlib"
    venv.create(target, with_pip=True)
    python = target / ("Scripts" if os.name == "nt" else "bin") / "python"
    packages = ["rtmlib", f"onnxruntime=={onnxruntime.__version__}", f"numpy=={np.__version__}"]
    subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
    return python


def distances_of_a_frame(
    ours: np.ndarray[Any, Any], counted: np.ndarray[Any, Any], theirs: np.ndarray[Any, Any]
) -> list[list[float]]:
    """Distances (px) of the counted keypoints of every person that both sides see."""
    out = []
    for xy, counts in zip(ours, counted, strict=True):
        if not len(theirs):
            break
        apart = np.linalg.norm(theirs - xy, axis=2)
        nearest = apart[np.argmin(np.nanmedian(apart, axis=1))]
        extent = float(np.ptp(xy[np.isfinite(xy).all(axis=1)], axis=0).max())
        if np.nanmedian(nearest) < extent / 4:  # else it is another person
            out.append(nearest[counts].tolist())
    return out


if __name__ == "__main__":
    main()
