"""What a recording holds, read back row by row."""

from __future__ import annotations

import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from dance2pose import portions
from dance2pose.angles import angle_names, track_angles
from dance2pose.commands.view import viewer_program
from dance2pose.poses import Dancer
from dance2pose.recording import writer as recording_module
from dance2pose.recording.writer import RecordingWriter
from dance2pose.skeleton import get
from dance2pose.video import open_video
from recording_making import JOINTS, KEYPOINTS, Recording, make_dancer, make_provenance, timeline_of
from video_making import numbered_video, read_number

FRAMES = 11


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eleven pictures at uneven times."""
    times_ms = [0, 40, 80, 160, 200, 210, 300, 340, 500, 540, 600]
    folder = tmp_path_factory.mktemp("video")
    return numbered_video(folder / "uneven.mp4", count=FRAMES, times_ms=times_ms)


def record(
    video: Path,
    path: Path,
    *,
    picture: str = "none",
    dancers: int = 2,
    last: int = 9,
    **kind: object,
) -> tuple[Recording, list[Dancer]]:
    """Dancers seen in frames 2 to `last`, recorded."""
    with (
        open_video(video) as frames,
        RecordingWriter(path, recording_id="one-id", picture=picture, video=frames.info) as out,  # type: ignore[arg-type]
    ):
        seen = []
        for frame in frames:
            out.picture_frame(frame)
            seen.append(frame)
        rows = seen[2 : last + 1]
        made = [
            make_dancer(
                n + 1,
                frame=[f.index for f in rows],
                time_s=[f.time_s for f in rows],
                x=100 - 60 * n,
                **kind,  # type: ignore[arg-type]
            )
            for n in range(dancers)
        ]
        out.write(made, make_provenance(), timeline_of(seen))
    return Recording(path), made


@pytest.fixture(scope="module")
def recorded(
    video: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Recording, list[Dancer], Path]:
    path = tmp_path_factory.mktemp("out") / "out.rrd"
    return *record(video, path), path


def rows_of(recording: Recording, entity: str, component: str) -> tuple[list[int], np.ndarray]:
    """Frames, and values as one array, of an entity's rows."""
    rows = recording.rows(entity, component)
    return [frame for frame, _, _ in rows], np.array([value for _, _, value in rows], float)


def test_holds_the_entities_and_timelines_of_the_design(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording = recorded[0]
    expected = {"/video", "/world", "/provenance", "/world/ruler/axes", "/world/ruler/numbers"}
    for n in (1, 2):
        expected |= {f"/video/dancer_{n}/{name}" for name in ("keypoints", "box")}
        expected |= {f"/world/dancer_{n}{name}" for name in ("", "/joints", "/raw")}
        overlays = ("guessed", "sigma", "contact", "facing")
        expected |= {f"/world/dancer_{n}/{name}" for name in overlays}
        plots = ("confidence", "reprojection_error", "invalid_bones", "sigma")
        expected |= {f"/plots/dancer_{n}/{name}" for name in plots}
        expected |= {f"/plots/dancer_{n}/angle/{name}" for name in angle_names("body17")}
    assert recording.entities == expected
    assert recording.timelines == {"frame", "video_time"}


def test_keypoints_and_joints_are_those_given(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording, dancers, _ = recorded
    for dancer in dancers:
        n = dancer.person
        for entity, component, values in (
            (f"/video/dancer_{n}/keypoints", "Points2D:positions", dancer.keypoints.xy),
            (f"/world/dancer_{n}/joints", "Points3D:positions", dancer.smoothed.xyz),
            (f"/world/dancer_{n}/raw", "Points3D:positions", dancer.raw.xyz),
        ):
            frame, found = rows_of(recording, entity, component)
            assert frame == [*dancer.keypoints.frame, 10]
            np.testing.assert_array_equal(found[:-1], values.astype(np.float32))
            assert np.isnan(found[-1]).all(), "the frame after the last must take the dancer off"


def test_joints_stand_in_balls_whose_radius_is_sigma(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording, dancers, _ = recorded
    rows = recording.rows("/world/dancer_1/sigma", "Ellipsoids3D:half_sizes")
    sigma = dancers[0].raw.sigma
    assert sigma is not None
    for row, known in enumerate(np.isfinite(dancers[0].smoothed.xyz).all(axis=2)):
        expected = np.repeat(sigma[row, known, None], 3, axis=1).astype(np.float32)
        np.testing.assert_array_equal(np.reshape(rows[row][2], (-1, 3)), expected)


def test_raw_poses_have_the_bones_whose_two_ends_are_known(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording, dancers, _ = recorded
    rows = recording.rows("/world/dancer_1/raw", "LineStrips3D:strips")
    raw = dancers[0].raw
    for row, xyz in enumerate(raw.xyz.astype(np.float32)):
        expected = [[xyz[a], xyz[b]] for a, b in get(JOINTS).bones if not np.isnan(xyz[a, 0])]
        assert len(rows[row][2]) == len(expected) == (0 if row == 3 else len(get(JOINTS)) - 1)
        np.testing.assert_array_equal(rows[row][2], expected)
    assert rows[-1][0] == 10
    assert rows[-1][2] == []


def test_dancers_sent_some_frames_at_a_time_are_the_same(
    video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, _ = record(video, tmp_path / "whole.rrd", picture="video")
    monkeypatch.setattr(portions, "FRAMES", 3)
    parts, _ = record(video, tmp_path / "parts.rrd", picture="video")
    assert parts.entities == whole.entities
    for n in (1, 2):
        for entity, component in (
            (f"/video/dancer_{n}/keypoints", "Points2D:positions"),
            (f"/world/dancer_{n}/joints", "Points3D:positions"),
            (f"/world/dancer_{n}/raw", "Points3D:positions"),
            (f"/plots/dancer_{n}/sigma", "Scalars:scalars"),
        ):
            (frame, found), (same, expected) = (
                rows_of(one, entity, component) for one in (parts, whole)
            )
            assert frame == same
            np.testing.assert_array_equal(found, expected)


def test_times_are_the_frames_own(
    video: Path, recorded: tuple[Recording, list[Dancer], Path]
) -> None:
    recording, dancers, _ = recorded
    rows = recording.rows("/video/dancer_1/keypoints", "Points2D:positions")
    found = [time_s for _, time_s, _ in rows[:-1]]
    np.testing.assert_allclose(found, dancers[0].keypoints.time_s, atol=2e-9)
    assert np.ptp(np.diff(found)) > 0.05


def test_a_dancer_who_stays_to_the_end_is_not_taken_off(video: Path, tmp_path: Path) -> None:
    recording, _ = record(video, tmp_path / "out.rrd", last=FRAMES - 1)
    frame, found = rows_of(recording, "/world/dancer_1/joints", "Points3D:positions")
    assert frame[-1] == FRAMES - 1
    assert not np.isnan(found[-1]).any()


def test_boxes_are_those_given_and_absent_where_nobody_was_detected(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording, dancers, _ = recorded
    centres = recording.rows("/video/dancer_1/box", "Boxes2D:centers")
    halves = recording.rows("/video/dancer_1/box", "Boxes2D:half_sizes")
    for row, box in enumerate(dancers[0].keypoints.box):
        centre, half = centres[row][2], halves[row][2]
        if np.isnan(box).any():
            assert centre == half == []
        else:
            low_high = np.concatenate([np.subtract(centre, half)[0], np.add(centre, half)[0]])
            np.testing.assert_allclose(low_high, box, atol=1e-4)
    assert centres[-1][2] == []


def test_plots_hold_angles_and_trust(recorded: tuple[Recording, list[Dancer], Path]) -> None:
    recording, dancers, _ = recorded
    dancer = dancers[1]
    track, joints = dancer.keypoints, dancer.smoothed

    def plot(name: str) -> np.ndarray:
        return rows_of(recording, f"/plots/dancer_2/{name}", "Scalars:scalars")[1][:, 0]

    for name, curve in track_angles(joints).items():
        np.testing.assert_allclose(plot(f"angle/{name}"), curve.degrees)
    for t in range(len(track)):
        seen = [j for j in range(track.xy.shape[1]) if not np.isnan(track.xy[t, j, 0])]
        lifted = not np.isnan(joints.xyz[t]).all()
        confidence = np.mean(track.confidence[t, seen]) if seen else np.nan
        error = np.mean(dancer.raw.reprojection_error[t]) if lifted else np.nan
        invalid = sum(not ok for ok in joints.valid[t]) if lifted else np.nan
        np.testing.assert_allclose(plot("confidence")[t], confidence)
        np.testing.assert_allclose(plot("reprojection_error")[t], error)
        np.testing.assert_array_equal(plot("invalid_bones")[t], invalid)


def test_plots_have_names_and_two_sides_two_colours(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording = recorded[0]
    left, right = (
        recording.static(f"/plots/dancer_1/angle/{side}_elbow_flexion", "SeriesLines:colors")
        for side in ("left", "right")
    )
    assert left != right
    name = recording.static("/plots/dancer_1/angle/left_elbow_flexion", "SeriesLines:names")
    assert name == ["left elbow flexion"]


def test_a_lifter_that_knows_no_uncertainty_has_no_plot_of_it(video: Path, tmp_path: Path) -> None:
    recording, _ = record(video, tmp_path / "out.rrd", with_sigma=False)
    assert not any("sigma" in entity for entity in recording.entities)


def test_skeletons_have_their_bones_and_every_dancer_a_colour(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording = recorded[0]
    for entity, skeleton in (("/video", KEYPOINTS), ("/world", JOINTS)):
        classes = recording.static(entity, "AnnotationContext:context")[0]
        assert [c["class_id"] for c in classes] == [1, 2]
        colours = {c["class_description"]["info"]["color"] for c in classes}
        assert len(colours) == 2
        for described in (c["class_description"] for c in classes):
            bones = [(b["keypoint0"], b["keypoint1"]) for b in described["keypoint_connections"]]
            assert tuple(bones) == get(skeleton).bones
            sides = {
                side: {k["color"] for k in described["keypoint_annotations"] if side in k["label"]}
                for side in ("left", "right")
            }
            assert len(sides["left"]) == len(sides["right"]) == 1
            assert sides["left"] != sides["right"]
    ids = recording.static("/world/dancer_2/joints", "Points3D:keypoint_ids")
    assert ids == list(range(len(get(JOINTS))))
    assert recording.static("/world/dancer_2/joints", "Points3D:class_ids") == [2]


def test_dancers_stand_side_by_side_on_the_floor_as_in_the_picture(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording, dancers, _ = recorded
    offsets = [
        np.array(recording.static(f"/world/dancer_{d.person}", "Transform3D:translation")[0])
        for d in dancers
    ]
    assert offsets[0][0] - offsets[1][0] == pytest.approx(1.2)  # dancer 2 is left of dancer 1
    for dancer, offset in zip(dancers, offsets, strict=True):
        lowest = np.nanmin(dancer.smoothed.xyz[..., 1]) + offset[1]
        assert abs(lowest) < 0.02
    text = recording.static("/provenance", "TextDocument:text")[0]
    assert "1.2 body heights apart" in text


def test_dancers_whose_path_is_known_move_along_it(video: Path, tmp_path: Path) -> None:
    path = np.stack([np.linspace(0, 3, 8), np.zeros(8), np.linspace(-5, -4, 8)], axis=1)
    recording, dancers = record(video, tmp_path / "out.rrd", root=path)
    _, found = rows_of(recording, "/world/dancer_1/joints", "Points3D:positions")
    expected = dancers[0].smoothed.xyz + path[:, None]
    np.testing.assert_allclose(found[:-1], expected, atol=1e-6)
    offsets = {
        tuple(recording.static(f"/world/dancer_{n}", "Transform3D:translation")[0]) for n in (1, 2)
    }
    assert len(offsets) == 1, "known places must keep their distance"


def test_provenance_is_readable_and_in_the_properties(
    recorded: tuple[Recording, list[Dancer], Path],
) -> None:
    recording = recorded[0]
    assert "The last second is missing." in recording.static("/provenance", "TextDocument:text")[0]
    assert recording.static("/provenance", "TextDocument:media_type") == ["text/markdown"]
    assert recording.static("/__properties/source", "sha256") == ["ab" * 32]
    assert recording.static("/__properties/settings", "setting_window") == [5]
    assert recording.static("/__properties", "RecordingInfo:name") == ["uneven.mp4"]


def test_has_its_id_and_its_layout(recorded: tuple[Recording, list[Dancer], Path]) -> None:
    reader = recorded[0].reader
    (entry,) = reader.recordings()
    assert (entry.application_id, entry.recording_id) == ("dance2pose", "one-id")
    (layout,) = reader.blueprints()
    entities = {chunk.entity_path for chunk in reader.stream(store=layout)}
    assert (
        sum(path.count("/") == 2 and path.startswith("/view/") for path in entities)
        == 2 * 12 + 2 * 7 + 3
    )


def test_rerun_itself_finds_it_whole(recorded: tuple[Recording, list[Dancer], Path]) -> None:
    verdict = subprocess.run(
        [viewer_program(), "rrd", "verify", recorded[2]], capture_output=True, text=True, timeout=60
    )
    assert verdict.returncode == 0, verdict.stderr


@pytest.mark.parametrize("picture", ["none", "frames", "video"])
def test_a_video_without_dancers_is_recorded_too(video: Path, tmp_path: Path, picture: str) -> None:
    recording, _ = record(video, tmp_path / "out.rrd", dancers=0, picture=picture)
    assert "/provenance" in recording.entities
    assert not any("dancer" in entity for entity in recording.entities)
    assert len(recording.reader.blueprints()) == 1


def test_frames_are_recorded_as_they_come(
    video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_module, "_BATCH_BYTES", 2000)
    sizes = []
    path = tmp_path / "out.rrd"
    with (
        open_video(video) as frames,
        RecordingWriter(path, recording_id="id", picture="frames", video=frames.info) as out,
    ):
        seen = []
        for frame in frames:
            out.picture_frame(frame)
            seen.append(frame)
            sizes.append(sum(p.stat().st_size for p in tmp_path.iterdir()))
        out.write([], make_provenance(), timeline_of(seen))
    times = timeline_of(seen).time_s
    assert sizes[-1] - sizes[2] > 2000, "pictures must not wait for the end of the video"
    rows = Recording(path).rows("/video", "EncodedImage:blob")
    assert [frame for frame, _, _ in rows] == list(range(FRAMES))
    np.testing.assert_allclose([time_s for _, time_s, _ in rows], times, atol=2e-9)
    for frame, _, (jpeg,) in rows:
        image = cv2.imdecode(np.array(jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert read_number(image) == frame
