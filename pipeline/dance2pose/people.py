"""The ONNX models of a run, and the people that they find in frame after frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from dance2pose.detection import Detector, load_detector
from dance2pose.errors import UsageError
from dance2pose.keypoints import KeypointEstimator, OneStageEstimator, load_pose_model
from dance2pose.onnx_models.answers import Answers
from dance2pose.onnx_models.inference import default_threads
from dance2pose.onnx_models.recognition import ModelDescription
from dance2pose.options import Settings
from dance2pose.poses import Boxes, Frame, Image, Poses2D

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

    def find(self, image: Image) -> tuple[Boxes, Poses2D]:
        """The people of one picture, as boxes and keypoints in the same order."""
        if isinstance(self.estimator, OneStageEstimator):
            return self.estimator.find(image)
        assert self.detector is not None  # held by load_models
        boxes = self.detector.detect(image)
        return boxes, self.estimator.estimate(image, boxes)


def load_models(settings: Settings) -> PoseModels:
    """Load the models that the settings name. Raises UsageError where one is not named.

    Each runs in one thread: several frames side by side use the cores better than several threads
    within the small operators of one frame do (see `find_ahead`).
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
    least = settings.min_confidence
    estimator = load_pose_model(settings.pose, threads=1, min_confidence=least)
    if isinstance(estimator, OneStageEstimator):
        return PoseModels(None, estimator)
    if settings.detector is None:
        raise UsageError(
            f"{settings.pose}: estimates keypoints inside boxes; name a person detector as well "
            "with --detector D.onnx"
        )
    return PoseModels(load_detector(settings.detector, threads=1, min_confidence=least), estimator)


def find_ahead(
    frames: Iterable[Frame], models: PoseModels
) -> Iterator[tuple[Frame, tuple[Boxes, Poses2D]]]:
    """The frames in order, each with its people, found in as many threads as there are cores.

    At most one frame more than there are threads is held, whatever the length of the video.
    """
    threads = default_threads()
    waiting: deque[tuple[Frame, Future[tuple[Boxes, Poses2D]]]] = deque()
    with ThreadPoolExecutor(threads, thread_name_prefix="models") as pool:
        try:
            for frame in frames:
                waiting.append((frame, pool.submit(models.find, frame.image)))
                if len(waiting) > threads:
                    done, people = waiting.popleft()
                    yield done, people.result()
            for done, people in waiting:
                yield done, people.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
