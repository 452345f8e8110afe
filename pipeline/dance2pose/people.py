"""The ONNX models of a run, and the people that they find in frame after frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import cast

import cv2

from dance2pose.detection import Detector, WholePictureModel, load_detector
from dance2pose.errors import UsageError
from dance2pose.following import Stretch, find_in_stretch
from dance2pose.keypoints import (
    KeypointEstimator,
    OneStageEstimator,
    OnnxKeypoints,
    load_pose_model,
)
from dance2pose.large_blocks import give_back_large_blocks
from dance2pose.onnx_models.answers import Answers
from dance2pose.onnx_models.inference import usable_cores
from dance2pose.onnx_models.recognition import ModelDescription
from dance2pose.options import Settings, SpeedOptions
from dance2pose.poses import Boxes, Frame, Image, Poses2D
from dance2pose.profiling import stage
from dance2pose.shots import ShotDetector

# Nobody is followed over a longer step between two frames, ...
LONGEST_STEP_S = 0.1
# ... nor for longer than this without the detector, whatever the frame rate.
LONGEST_UNSEEN_S = 0.5
# Pictures waiting to be worked on, for each thread; of large ones no more than are worked on.
BYTES_A_THREAD = 96 * 1024**2

# What a person without models is told to fetch: names of models/registry.toml.
DETECTOR_TO_PULL, POSE_TO_PULL = "yolox-tiny", "rtmpose-m"


@dataclass(frozen=True)
class PoseModels:
    """The ONNX models of a run: a detector and a keypoint model, or a one-stage model alone."""

    detector: Detector | None
    estimator: KeypointEstimator | OneStageEstimator

    @property
    def skeleton(self) -> str:
        return self.estimator.skeleton

    @property
    def descriptions(self) -> tuple[ModelDescription, ...]:
        """What each model is and how it is read."""
        loaded = (self.detector, self.estimator)
        return tuple(model.description for model in loaded if model is not None)

    @property
    def accounts(self) -> tuple[Answers, ...]:
        """What each model answered so far."""
        models = (self.detector, self.estimator)
        return tuple(model.answers for model in models if model is not None)

    def describe_reading(self) -> str:
        """How each model was read and the best score it gave, for a person to judge by."""
        models = (self.detector, self.estimator)
        return "; ".join(model.describe_reading() for model in models if model is not None)

    @property
    def hardware(self) -> dict[str, str]:
        """What ONNX Runtime really runs each model with, by role; for the provenance."""
        return {f"{role} runs with": model.session.runs_with for role, model in self._sessions()}

    @property
    def notes(self) -> tuple[str, ...]:
        """What was asked for and could not be had; each must be told to the person."""
        found = [model.session.note for _, model in self._sessions()]
        return tuple(dict.fromkeys(note for note in found if note))

    def _sessions(self) -> list[tuple[str, WholePictureModel | OnnxKeypoints]]:
        models = [("detector", self.detector), ("keypoint model", self.estimator)]
        return [
            (role, model)
            for role, model in models
            if isinstance(model, WholePictureModel | OnnxKeypoints)
        ]

    def detect(self, image: Image) -> Boxes:
        """The people of one picture, as boxes. Not for one-stage models, which give both."""
        assert self.detector is not None  # held by load_models
        with stage("detector"):
            return self.detector.detect(image)

    def estimate(self, image: Image, boxes: Boxes) -> Poses2D:
        """The keypoints of those in the boxes. Not for one-stage models."""
        estimator = cast(KeypointEstimator, self.estimator)  # held by load_models
        if not len(boxes):
            return estimator.estimate(image, boxes)
        with stage("keypoints"):
            return estimator.estimate(image, boxes)

    def find(self, image: Image) -> tuple[Boxes, Poses2D]:
        """The people of one picture, as boxes and keypoints in the same order."""
        if isinstance(self.estimator, OneStageEstimator):
            with stage("keypoints"):
                return self.estimator.find(image)
        boxes = self.detect(image)
        return boxes, self.estimate(image, boxes)


def load_models(settings: Settings) -> PoseModels:
    """Load the models that the settings name. Raises UsageError where one is not named.

    Each runs in one thread: several frames side by side use the cores better than several threads
    within the small operators of one frame do (see `find_people`).
    """
    if settings.pose is None:
        raise UsageError(
            "no keypoint model is named; name ONNX models with --detector D.onnx --pose P.onnx\n"
            "or in the settings file. To fetch a well-known pair and use it:\n"
            f"  dance2pose models pull {DETECTOR_TO_PULL}\n"
            f"  dance2pose models pull {POSE_TO_PULL}\n"
            f"  dance2pose VIDEO --detector {DETECTOR_TO_PULL} --pose {POSE_TO_PULL}\n"
            "`dance2pose demo` shows a result without any"
        )
    speed, least = settings.speed, settings.min_confidence
    estimator = load_pose_model(
        settings.pose,
        threads=1,
        provider=speed.provider,
        batch=speed.batch,
        min_confidence=least,
    )
    if isinstance(estimator, OneStageEstimator):
        return PoseModels(None, estimator)
    if settings.detector is None:
        raise UsageError(
            f"{settings.pose}: estimates keypoints inside boxes; name a person detector as well "
            "with --detector D.onnx"
        )
    detector = load_detector(
        settings.detector, threads=1, provider=speed.provider, min_confidence=least
    )
    return PoseModels(detector, estimator)


@dataclass(frozen=True)
class FramePeople:
    """A frame and its people. boxes, poses: the same N people. cut: a new shot begins here."""

    frame: Frame
    boxes: Boxes
    poses: Poses2D
    cut: bool


def find_people(
    frames: Iterable[Frame], models: PoseModels, options: SpeedOptions | None = None
) -> Iterator[FramePeople]:
    """The frames in order, each with its people, found in as many threads as there are cores.

    The detector looks at the first frame of every shot, at its last, and at every
    `options.detect_every`-th between; `following` finds the people of the frames in between.
    One-stage models look at every frame. What is found does not depend on the number of threads.

    A few stretches of `detect_every` frames are held, whatever the length of the video.
    """
    options = options or SpeedOptions()
    one_stage = models.detector is None
    give_back_large_blocks()
    opencv_threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # the frames side by side use the cores
    work = _Work(models, options.threads or usable_cores())
    try:
        for stretch in stretches(frames, 1 if one_stage else options.detect_every):
            yield from work.submit(stretch)
        yield from work.finish()
    finally:
        work.close()
        cv2.setNumThreads(opencv_threads)


def stretches(frames: Iterable[Frame], detect_every: int) -> Iterator[Stretch]:
    """Cut the frames of a video at its key frames.

    A stretch ends where a shot does, after `detect_every` frames, after `LONGEST_UNSEEN_S`, and
    before a step in time of more than `LONGEST_STEP_S`.
    """
    shots = ShotDetector()
    gathered: list[Frame] = []
    cut = False
    for frame in frames:
        with stage("cuts"):
            is_cut = shots.is_cut(frame)
        if gathered:
            apart = is_cut or frame.time_s - gathered[-1].time_s > LONGEST_STEP_S
            full = (
                len(gathered) >= detect_every
                or frame.time_s - gathered[0].time_s >= LONGEST_UNSEEN_S - _ROUNDING_S
            )
            if apart:
                yield Stretch(tuple(gathered), cut=cut)
            elif full:
                yield Stretch((*gathered, frame), next_begins=True, cut=cut)
            if apart or full:
                gathered, cut = [], is_cut
        gathered.append(frame)
    if gathered:
        yield Stretch(tuple(gathered), cut=cut)


# Timestamps are rounded in the file.
_ROUNDING_S = 1e-3

_Found = list[tuple[Boxes, Poses2D]]


class _Work:
    """Stretches being worked on in threads, their people given out in order."""

    def __init__(self, models: PoseModels, threads: int) -> None:
        self._models = models
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="models")
        self._waiting: deque[tuple[Stretch, Future[_Found]]] = deque()
        # What the detector sees in the first frame of the next stretch, begun by the one before.
        self._next_first: Future[Boxes] | None = None

    def submit(self, stretch: Stretch) -> Iterator[FramePeople]:
        """Begin with a stretch; gives the people of those that had to be waited for."""
        self._waiting.append((stretch, self._begin(stretch)))
        # One more than there are threads: who is done finds work while its result is looked at.
        held = min(self._threads + 1, self._threads * BYTES_A_THREAD // _bytes(stretch))
        while len(self._waiting) > max(held, min(self._threads, 2)):
            yield from self._oldest()

    def finish(self) -> Iterator[FramePeople]:
        while self._waiting:
            yield from self._oldest()

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _begin(self, stretch: Stretch) -> Future[_Found]:
        images = [frame.image for frame in stretch.frames]
        models, pool = self._models, self._pool
        if models.detector is None:
            return pool.submit(lambda: [models.find(image) for image in images[: len(stretch.own)]])
        # The detector's looks are begun before the stretch that waits for them, so that none
        # waits for one that has no thread.
        first = self._next_first or pool.submit(models.detect, images[0])
        last = first if len(images) == 1 else pool.submit(models.detect, images[-1])
        self._next_first = last if stretch.next_begins else None
        return pool.submit(lambda: find_in_stretch(stretch, first.result(), last.result(), models))

    def _oldest(self) -> Iterator[FramePeople]:
        stretch, found = self._waiting.popleft()
        for i, (frame, (boxes, poses)) in enumerate(zip(stretch.own, found.result(), strict=True)):
            yield FramePeople(frame, boxes, poses, cut=stretch.cut and i == 0)


def _bytes(stretch: Stretch) -> int:
    return sum(frame.image.nbytes for frame in stretch.frames)
