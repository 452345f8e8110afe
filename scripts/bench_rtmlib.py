"""rtmlib over a video; run by bench_pipeline.py with the Python of an environment of its own.

One argument: a JSON object with the video, the models and their input sizes, how often the
detector looks, and where to write the seconds taken and the keypoints of every frame.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import cv2
from rtmlib import YOLOX, PoseTracker, RTMPose


class TwoModels:
    """What rtmlib's PoseTracker asks of a solution: a detector of people and a pose model."""

    det_categories = (0,)  # COCO's person

    def __init__(self, job: dict[str, Any]) -> None:
        self.det_model = YOLOX(
            job["detector"],
            model_input_size=tuple(job["detector_size"]),
            det_mode="multiclass",
            nms_thr=job["nms_threshold"],
            score_thr=job["score_threshold"],
        )
        self.pose_model = RTMPose(job["pose"], model_input_size=tuple(job["pose_size"]))


def main() -> None:
    job = json.loads(sys.argv[1])
    wall, cpu = time.perf_counter(), time.process_time()
    # Without its tracking, which joins frames by their boxes, rtmlib is a little faster.
    tracker = PoseTracker(
        lambda **_: TwoModels(job), det_frequency=job["detect_every"], tracking=False
    )
    video = cv2.VideoCapture(job["video"])
    most = int((job["seconds"] or 1e9) * video.get(cv2.CAP_PROP_FPS))
    poses: list[list[list[float]]] = []
    while len(poses) < most:
        more, picture = video.read()
        if not more:
            break
        keypoints, _ = tracker(picture)
        poses.append([person.tolist() for person in keypoints])
    answer = {
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu,
        "poses": poses,
    }
    Path(job["output"]).write_text(json.dumps(answer))


if __name__ == "__main__":
    main()
