"""Training examples out of rendered samples: other places, people, occluders, crops and cameras."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from dance2pose.skeleton import get
from demo_training.backgrounds import Image
from demo_training.networks import DETECTOR_INPUT, POSE_INPUT
from figure_renderer.pool import Pool
from figure_renderer.samples import PICTURE

Array = npt.NDArray[np.floating]
Rng = np.random.Generator
MIRROR = list(get("coco23").mirror)
PADDING = 1.25
_GRAIN = np.clip(np.random.default_rng(0).normal(128, 20, (400, 400, 3)), 0, 255).astype(np.uint8)


@dataclass
class Figure:
    """picture (224, 224, 3) RGB, coverage (224, 224) 0 to 255, keypoints (23, 2) px; in_place:
    there is something around the figure."""

    picture: Image
    mask: Image
    points: Array
    in_place: bool


@dataclass
class Source:
    """The rendered figures and the pictures to put behind them."""

    pool: Pool
    backgrounds: Image

    def figure(self, rng: Rng, rows: int) -> Figure:
        """One of the first rows, mirrored half the time."""
        row = int(rng.integers(rows))
        whole = self.pool.pictures[row]
        points = np.array(self.pool.keypoints[row], np.float64)
        if rng.random() < 0.5:
            whole = whole[:, ::-1]
            points = points[MIRROR]
            points[:, 0] = PICTURE - 1 - points[:, 0]
        whole = np.ascontiguousarray(whole)
        return Figure(whole[..., :3], whole[..., 3], points, bool(self.pool.state[row] == 2))

    def some_background(self, rng: Rng, size: int) -> Image:
        image = self.backgrounds[rng.integers(len(self.backgrounds))]
        room = len(image) - size
        if room < 0 or rng.random() < 0.3:
            part = int(rng.integers(len(image) // 2, len(image)))
            image = cv2.resize(image[:part, :part], (size, size))
            return image[:, :: 1 if rng.random() < 0.5 else -1]
        x, y = rng.integers(0, room + 1, 2)
        return image[y : y + size, x : x + size, :: 1 if rng.random() < 0.5 else -1]


def mask_box(mask: Image) -> Array | None:
    """xyxy of the figure; None where hardly anything of it is seen."""
    x, y, width, height = cv2.boundingRect((mask > 127).astype(np.uint8))
    return None if min(width, height) < 4 else np.array([x, y, x + width, y + height], float)


def over(image: Image, layer: Image, mask: Image) -> Image:
    """A layer laid over a picture, by its coverage 0 to 255."""
    alpha = cv2.merge([mask] * 3)
    return cv2.add(
        cv2.multiply(layer, alpha, scale=1 / 255), cv2.multiply(image, 255 - alpha, scale=1 / 255)
    )


def occlude(rng: Rng, source: Source, image: Image) -> None:
    """Things in front of the figure, in place."""
    height, width = image.shape[:2]
    for _ in range(int(rng.integers(1, 4))):
        size = int(rng.uniform(0.06, 0.33) * width)
        x, y = int(rng.integers(0, width - size)), int(rng.integers(0, height - size))
        tall = min(height - y, int(size * rng.uniform(0.4, 2.5)))
        patch = cv2.resize(source.some_background(rng, 96), (size, tall))
        if rng.random() < 0.5:
            image[y : y + tall, x : x + size] = patch
        else:
            shape = np.zeros((tall, size), np.uint8)
            cv2.ellipse(shape, (size // 2, tall // 2), (size // 2, tall // 2), 0, 0, 360, 1, -1)
            image[y : y + tall, x : x + size][shape > 0] = patch[shape > 0]


def photograph(rng: Rng, image: Image) -> Image:
    """What a camera and a codec do: exposure, colour, blur, little resolution, grain, JPEG."""
    if rng.random() < 0.12:
        image = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    gain = rng.uniform(0.8, 1.2, 3) if rng.random() < 0.6 else np.ones(3)
    curve = (np.arange(256) - 128) * rng.uniform(0.55, 1.35) + 128 + rng.uniform(-40, 40)
    curve = np.clip(curve[:, None] * gain, 0, 255)
    if rng.random() < 0.4:
        curve = 255 * (curve / 255) ** rng.uniform(0.55, 1.7)
    out = cv2.LUT(np.ascontiguousarray(image), curve.astype(np.uint8)[None])
    blur = rng.random()
    if blur < 0.25:
        out = cv2.GaussianBlur(out, (0, 0), float(rng.uniform(0.4, 1.8)))
    elif blur < 0.4:
        length = int(rng.integers(3, 9))
        kernel = np.zeros((length, length), np.float32)
        middle, angle = (length - 1) / 2, rng.uniform(0, np.pi)
        reach = middle * np.array([np.cos(angle), np.sin(angle)])
        a = (round(middle - reach[0]), round(middle - reach[1]))
        b = (round(middle + reach[0]), round(middle + reach[1]))
        cv2.line(kernel, a, b, 1.0)
        out = cv2.filter2D(out, -1, kernel / kernel.sum())
    if rng.random() < 0.25:
        height, width = out.shape[:2]
        part = rng.uniform(0.35, 0.9)
        small = cv2.resize(
            out, (int(width * part), int(height * part)), interpolation=cv2.INTER_AREA
        )
        out = cv2.resize(small, (width, height))
    if rng.random() < 0.4:
        y, x = rng.integers(0, len(_GRAIN) - np.array(out.shape[:2]))
        grain = _GRAIN[y : y + out.shape[0], x : x + out.shape[1]]
        strength = float(rng.uniform(0.05, 0.6))
        out = cv2.addWeighted(out, 1.0, grain, strength, -128 * strength)
    if rng.random() < 0.4:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(20, 85))]
        out = cv2.imdecode(cv2.imencode(".jpg", out, quality)[1], cv2.IMREAD_COLOR)
    return out


def pose_example(rng: Rng, source: Source, rows: int) -> tuple[Image, Array, npt.NDArray[np.bool_]]:
    """A crop (160, 120, 3) RGB as the keypoint model gets it, keypoints (23, 2) px in it, and
    which of them lie in the picture."""
    height, width = POSE_INPUT
    while True:
        figure = source.figure(rng, rows)
        box = mask_box(figure.mask)
        if box is not None:
            break
    picture, mask, points = figure.picture, figure.mask, figure.points
    if not figure.in_place or rng.random() < 0.35:
        behind = source.some_background(rng, PICTURE)
        picture = over(behind, picture, cv2.GaussianBlur(mask, (3, 3), 0.6))
    if rng.random() < 0.2:  # a second dancer, behind the first or before it
        other = source.figure(rng, rows)
        side = float(rng.choice([-1, 1])) * rng.uniform(0.35, 0.9) * (box[2] - box[0])
        shift = np.array([[1, 0, side], [0, 1, rng.normal(0, 12)]])
        visible = cv2.warpAffine(other.mask, shift, (PICTURE, PICTURE))
        if rng.random() < 0.6:
            visible = cv2.multiply(visible, 255 - mask, scale=1 / 255)
        layer = cv2.warpAffine(other.picture, shift, (PICTURE, PICTURE))
        picture = over(picture, layer, visible)
    limits = np.array([0.0, 0.0, PICTURE, PICTURE])
    if rng.random() < 0.18:  # the picture's edge cuts the figure, often at the waist
        cut = box[1] + (box[3] - box[1]) * rng.uniform(0.4, 0.9)
        if rng.random() < 0.8:
            limits[3] = cut
        elif rng.random() < 0.5:
            limits[2] = box[0] + (box[2] - box[0]) * rng.uniform(0.5, 0.9)
        else:
            limits[0] = box[0] + (box[2] - box[0]) * rng.uniform(0.1, 0.5)
        box = np.array([*np.maximum(box[:2], limits[:2]), *np.minimum(box[2:], limits[2:])])
        kept = np.zeros_like(picture)
        x0, y0, x1, y1 = (int(v) for v in limits)
        kept[y0:y1, x0:x1] = picture[y0:y1, x0:x1]
        picture = kept
    middle, size = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
    middle = middle + size * rng.normal(0, 0.045, 2)
    size = size * np.exp(rng.normal(0, 0.09, 2))
    tall = max(size[1], size[0] * height / width) * PADDING
    angle = rng.normal(0, 15) if rng.random() < 0.6 else 0.0
    if rng.random() < 0.03:
        angle = rng.uniform(-180, 180)
    turn = cv2.getRotationMatrix2D((float(middle[0]), float(middle[1])), angle, height / tall)
    turn[:, 2] += np.array([width / 2 - 0.5, height / 2 - 0.5]) - middle
    edge = cv2.BORDER_CONSTANT if rng.random() < 0.4 else cv2.BORDER_REFLECT_101
    crop = cv2.warpAffine(picture, turn, (width, height), flags=cv2.INTER_LINEAR, borderMode=edge)
    placed = points @ turn[:, :2].T + turn[:, 2]
    inside = ((placed >= 0) & (placed < (width, height))).all(1)
    inside &= ((points >= limits[:2]) & (points < limits[2:])).all(1)
    if rng.random() < 0.35:
        occlude(rng, source, crop)
    return photograph(rng, crop), placed, inside


def detector_example(rng: Rng, source: Source, rows: int) -> tuple[Image, Array]:
    """A scene (224, 224, 3) RGB squeezed from a random aspect, and the boxes (N, 4) of its
    people in it."""
    size = DETECTOR_INPUT
    stretch = float(np.exp(rng.uniform(np.log(0.5), np.log(1.9))))  # width over height of the video
    if rng.random() < 0.25:  # one figure where it was rendered, the floor and its shadow with it
        return _zoomed(rng, source.figure(rng, rows), stretch)
    image = np.ascontiguousarray(source.some_background(rng, size))
    seen: list[npt.NDArray[np.bool_]] = []
    whole: list[int] = []
    for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.08, 0.5, 0.27, 0.15]))):
        figure = source.figure(rng, rows)
        box = mask_box(figure.mask)
        if box is None:
            continue
        tall = size * np.exp(rng.uniform(np.log(0.2), np.log(1.15)))
        scale = tall / max(box[3] - box[1], 0.7 * (box[2] - box[0]))
        middle = rng.uniform(0.1, 0.9, 2) * size
        grow = np.array([[scale / stretch, 0, 0], [0, scale, 0]], float)
        grow[:, 2] = middle - grow[:, :2] @ ((box[:2] + box[2:]) / 2)
        alpha = cv2.warpAffine(figure.mask, grow, (size, size))
        image = over(image, cv2.warpAffine(figure.picture, grow, (size, size)), alpha)
        here = alpha > 127
        seen = [old & ~here for old in seen] + [here]
        whole.append(int(here.sum()))
    boxes = [
        mask_box(mask.astype(np.uint8) * 255)
        for mask, area in zip(seen, whole, strict=True)
        if mask.sum() > max(60, 0.25 * area)
    ]
    if rng.random() < 0.15:
        occlude(rng, source, image)
    return photograph(rng, image), np.array([b for b in boxes if b is not None]).reshape(-1, 4)


def _zoomed(rng: Rng, figure: Figure, stretch: float) -> tuple[Image, Array]:
    size = DETECTOR_INPUT
    scale = size / PICTURE * rng.uniform(0.6, 1.5)
    grow = np.array([[scale * min(1, 1 / stretch), 0, 0], [0, scale * min(1, stretch), 0]], float)
    grow[:, 2] = size / 2 - grow[:, :2] @ np.full(2, PICTURE / 2) + rng.normal(0, 14, 2)
    image = cv2.warpAffine(figure.picture, grow, (size, size), borderMode=cv2.BORDER_REPLICATE)
    box = mask_box(cv2.warpAffine(figure.mask, grow, (size, size)))
    return photograph(rng, image), np.zeros((0, 4)) if box is None else box[None]
