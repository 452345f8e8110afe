"""How a recording looks: axes, skeletons, colours and widths, all of it logged once."""

from __future__ import annotations

from collections.abc import Sequence

from dance2pose.poses import Dancer
from dance2pose.recording.entities import (
    PICTURE,
    WORLD,
    box_path,
    dancer_path,
    filled_in_path,
    joints_path,
    keypoints_path,
    plots_path,
    projected_path,
    raw_path,
    ruler_path,
)
from dance2pose.recording.overlays import all_positions, ruler
from dance2pose.recording.placement import Placement
from dance2pose.recording.plots import angle_curves, trust_curves
from dance2pose.recording.quiet_rerun import rr
from dance2pose.skeleton import Skeleton, body_keypoints, get

Colour = tuple[int, int, int]
# One a dancer, legible on a dark ground and on most pictures; never near the two side colours.
_DANCERS: tuple[Colour, ...] = (
    (255, 214, 64),
    (80, 220, 130),
    (225, 130, 255),
    (240, 240, 240),
    (64, 224, 224),
    (255, 160, 200),
)
_LEFT: Colour = (80, 160, 255)
_RIGHT: Colour = (255, 100, 80)
_RAW: Colour = (120, 120, 132)
# Radii of keypoints, in points of the screen.
_BODY_POINTS, _SMALL_POINTS = 3.0, 1.2
_PLOT: Colour = (220, 220, 220)
# What was not seen: filled in, or from the body model alone.
_NOT_SEEN: Colour = (150, 150, 160)
_CONTACT: Colour = (120, 255, 120)
_WHITE: Colour = (255, 255, 255)
_RULER: Colour = (150, 150, 160)


def send_style(stream: rr.RecordingStream, dancers: Sequence[Dancer], placement: Placement) -> None:
    """Axes, skeletons, and the styles of every entity of the dancers."""
    stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    for path, skeletons in (
        (PICTURE, {d.person: d.keypoints.skeleton for d in dancers}),
        (WORLD, {d.person: d.smoothed.skeleton for d in dancers}),
    ):
        if skeletons:
            classes = [_skeleton_class(person, get(name)) for person, name in skeletons.items()]
            stream.log(path, rr.AnnotationContext(classes), static=True)
    _send_ruler(stream, dancers, placement)
    for dancer, offset in zip(dancers, placement.offsets, strict=True):
        move = rr.Transform3D(translation=offset)
        stream.log(dancer_path(dancer.person), move, static=True)
        _style_picture(stream, dancer, named=len(dancers) > 1)
        _style_world(stream, dancer)
        _style_plots(stream, dancer)


def _send_ruler(
    stream: rr.RecordingStream, dancers: Sequence[Dancer], placement: Placement
) -> None:
    """Axes with numbers on the floor."""
    if not dancers:
        return
    points = all_positions(dancers, placement.offsets)
    lines, places, labels = ruler(points, dancers[0].smoothed.unit)
    if lines:
        strips = rr.LineStrips3D(lines, colors=_RULER, radii=rr.Radius.ui_points(0.75))
        stream.log(f"{ruler_path()}/axes", strips, static=True)
        numbers = rr.Points3D(
            places,
            labels=labels,
            show_labels=True,
            colors=_RULER,
            radii=rr.Radius.ui_points(1.5),
        )
        stream.log(f"{ruler_path()}/numbers", numbers, static=True)


def _skeleton_class(person: int, skeleton: Skeleton) -> rr.ClassDescription:
    """A skeleton in the dancer's colour, its joints coloured by side."""
    colour = dancer_colour(person)
    return rr.ClassDescription(
        info=rr.AnnotationInfo(id=person, label=f"dancer {person}", color=colour),
        keypoint_annotations=[
            rr.AnnotationInfo(id=j, label=name, color=side_colour(name, colour))
            for j, name in enumerate(skeleton.joints)
        ],
        keypoint_connections=skeleton.bones,
    )


def dancer_colour(person: int) -> Colour:
    """Red, green, blue of a dancer (numbered from 1)."""
    return _DANCERS[(person - 1) % len(_DANCERS)]


def side_colour(joint: str, middle: Colour) -> Colour:
    parts = joint.split("_")
    return _LEFT if "left" in parts else _RIGHT if "right" in parts else middle


def _style_picture(stream: rr.RecordingStream, dancer: Dancer, *, named: bool) -> None:
    person = dancer.person
    keypoints = rr.Points2D.from_fields(
        radii=_radii(dancer.keypoints.skeleton),
        show_labels=False,
        draw_order=20.0,
        class_ids=person,
        keypoint_ids=range(len(get(dancer.keypoints.skeleton))),
    )
    box = rr.Boxes2D.from_fields(
        labels=f"dancer {person}",
        show_labels=named,
        draw_order=10.0,
        radii=rr.Radius.ui_points(0.75),
        class_ids=person,
    )
    stream.log(keypoints_path(person), keypoints, static=True)
    if dancer.keypoints.interpolated.any():
        filled = rr.Points2D.from_fields(
            radii=rr.Radius.ui_points(2.0), colors=_NOT_SEEN, show_labels=False, draw_order=20.0
        )
        stream.log(filled_in_path(person), filled, static=True)
    if dancer.smoothed.viewpoint is not None:
        projected = rr.LineStrips2D.from_fields(
            radii=rr.Radius.ui_points(0.75), colors=_WHITE, draw_order=15.0
        )
        stream.log(projected_path(person), projected, static=True)
    stream.log(box_path(person), box, static=True)


def _radii(skeleton: str) -> list[float]:
    """One for all keypoints, or a smaller one for those of face and hands, which lie close."""
    count, body = len(get(skeleton)), len(body_keypoints(skeleton))
    # Negative: points of the screen, not pixels of the picture.
    sizes = [-_BODY_POINTS] if count == body else [-_BODY_POINTS] * body
    sizes += [-_SMALL_POINTS] * (count - body)
    return sizes


def _style_world(stream: rr.RecordingStream, dancer: Dancer) -> None:
    person = dancer.person
    joints = rr.Points3D.from_fields(
        radii=rr.Radius.ui_points(4.0),
        show_labels=False,
        class_ids=person,
        keypoint_ids=range(len(get(dancer.smoothed.skeleton))),
    )
    stream.log(joints_path(person), joints, static=True)
    base = dancer_path(person)
    guessed = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(0.75), colors=_NOT_SEEN)
    stream.log(f"{base}/guessed", guessed, static=True)
    if dancer.raw.sigma is not None:
        balls = rr.Ellipsoids3D.from_fields(
            colors=dancer_colour(person),
            line_radii=rr.Radius.ui_points(0.35),
            fill_mode=rr.components.FillMode.MajorWireframe,
            show_labels=False,
        )
        stream.log(f"{base}/sigma", balls, static=True)
    contact = rr.Points3D.from_fields(radii=rr.Radius.ui_points(7.0), colors=_CONTACT)
    stream.log(f"{base}/contact", contact, static=True)
    arrow = rr.Arrows3D.from_fields(colors=_WHITE, radii=rr.Radius.ui_points(2.5))
    stream.log(f"{base}/facing", arrow, static=True)
    # Faint is thin and grey: the viewer draws no transparent lines.
    raw_joints = rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5), colors=_RAW)
    raw_bones = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(0.5), colors=_RAW)
    stream.log(raw_path(person), raw_joints, raw_bones, static=True)


def _style_plots(stream: rr.RecordingStream, dancer: Dancer) -> None:
    base = plots_path(dancer.person)
    for joint, curve in angle_curves(dancer).items():
        line = rr.SeriesLines(colors=side_colour(joint, _PLOT), names=curve.title, widths=1.5)
        stream.log(f"{base}/angle/{joint}", line, static=True)
    for name, curve in trust_curves(dancer).items():
        line = rr.SeriesLines(colors=_PLOT, names=curve.title, widths=1.5)
        stream.log(f"{base}/{name}", line, static=True)
