"""Bad input ends in one clear line that names the file, soon and in little memory."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dance2pose.commands.lift import lift
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import write_track
from dance2pose.npz_files import read_arrays
from dance2pose.reading import read_tracks
from reading_making import HEIGHT, MADE, RATE, WIDTH, coco, openpose, scene


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "not a JSON file: it is empty"),
        ("  \n", "not a JSON file: it is empty"),
        ('[{"image_id": 1', "not a JSON file"),
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        ('[{"image_id": 1, "keypoints": ' + "[" * 90_000 + "]" * 90_000 + "}]", "nested"),
        ('{"frames": [' + '{"landmarks": [' * 700 + "]}" * 700 + "]}", "nested|no person"),
        ("3", "not a form .* it holds a int"),
        ("null", "not a form .* it holds a NoneType"),
        ("{}", "it is empty; expected OpenPose JSON, COCO annotations"),
        ("[]", "holds no picture and no person"),
        ('[{"score": 1, "box": []}]', r"\[0\] has no image_id and no keypoints; it holds: score"),
        ('[{"keypoints": [1, 2, 3]}]', r"\[0\] has no image_id; it holds: keypoints"),
        ("[5]", r"\[0\] is of type int, expected image_id, keypoints"),
        ('[{"image_id": 1, "keypoints": "abc"}]', r"\[0\].keypoints is of type str"),
        ('[{"image_id": 1, "keypoints": [1, 2, "x"]}]', "plain numbers"),
        ('[{"image_id": 1, "keypoints": [1, [2], 3]}]', "plain numbers"),
        ('[{"image_id": 1, "keypoints": [1, 2, 3, 4, 5]}]', "5 numbers, expected x, y, confidence"),
        ('[{"image_id": 1, "keypoints": [1, 2, 3]}]', "1 keypoints; known numbers: 16"),
        ('[{"image_id": 1, "keypoints": [1, 2, 3], "score": "high"}]', "score is 'high'"),
        ('[{"image_id": [1], "keypoints": [1, 2, 3]}]', "image_id is of type list"),
        ('{"images": []}', "it holds images; expected OpenPose JSON"),
        ('{"images": [], "annotations": 4}', "annotations is of type int"),
        ('{"images": [{"file_name": "a"}], "annotations": []}', r"images\[0\] has no id"),
        ('{"instance_info": 4}', "instance_info is of type int"),
        (
            '[{"frame_id": 0, "instances": {"a": 1}}]',
            "expected image_id, keypoints|has no image_id",
        ),
        ('[{"frame_id": 0, "instances": [{"bbox": [1]}]}]', r"instances\[0\] has no keypoints"),
        ('{"keypoints": [[[[1, 2]]]], "scores": [[[1]], [[1]]]}', "not lists of one length"),
        ('{"keypoints": [[1, 2], [3]], "scores": [[1], [1]]}', "do not hold plain numbers"),
        ('{"landmarks": [{"x": 0.1, "y": 0.2}]}', "1 of them, expected MediaPipe Pose's 33"),
    ],
)
def test_what_is_wrong_with_a_json_file_is_said(
    tmp_path: Path, content: str, complaint: str
) -> None:
    path = tmp_path / "results.json"
    path.write_text(content)
    with pytest.raises(DataError, match=complaint) as caught:
        read_tracks(path, frame_rate=25)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "the file is empty"),
        ("hello\n", "it holds the columns hello; expected DeepLabCut CSV"),
        ("frame,a,b\n1,2,3\n", "it holds the columns frame, a, b"),
        ("a_x,a_y,b_x,b_y,c_x,c_y,d_x,d_y\n1,2\n", ":2: has 2 cells, expected 8"),
        ("a_x,a_y,b_x,b_y,c_x,c_y,d_x,d_y\n1,2,3,4,5,6,7,q\n", ":2: 'q' is not a finite number"),
        ("nose_x,nose_y,nose_z,b_x,b_y,b_z,c_x,c_y,c_z,d_x,d_y,d_z\n", "holds 3D positions"),
        ("x," * 1_000_000 + "x\n", "has 1000001 columns, expected at most"),
        ("frame,joint,x,y\n0,nose,5,5\n0,nose,6,6\n", "a second row of keypoint 'nose' in frame 0"),
        ("scorer,a,a\nbodyparts,b\ncoords,x,y\n0,1,2\n", "different numbers of cells|has 3 cells"),
        (
            "frame;nose_x;nose_y;b_x;b_y;c_x;c_y;d_x;d_y\n0;1,5;2.5;1;1;1;1;1;1\n",
            "decimal commas and",
        ),
    ],
)
def test_what_is_wrong_with_a_table_is_said(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=complaint):
        read_tracks(path, frame_rate=25)


def test_two_rows_a_frame_without_a_column_for_who_are_refused(tmp_path: Path) -> None:
    path = MADE["sleap csv"].write(tmp_path, scene("coco17"))
    rows = [line.split(",", 1)[1] for line in path.read_text().splitlines()]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(
        DataError, match=r"frame 3 has several rows, and no column \(such as person"
    ):
        read_tracks(path, frame_rate=25)


def test_what_is_not_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_tracks(tmp_path / "absent.txt", frame_rate=25)
    with pytest.raises(DataError, match="cannot be read"):
        read_tracks(tmp_path / "absent.json", frame_rate=25)
    with pytest.raises(DataError, match=r"holds no \.json file"):
        read_tracks(tmp_path, frame_rate=25)
    for name, complaint in (
        ("poses.xml", "not a form of 2D keypoints that is known; expected a track .npz"),
        ("poses.pkl", "pickles can run code and are never read"),
        ("poses.h5", "not an .h5 file that can be read"),
    ):
        (tmp_path / name).write_text("<poses/>")
        with pytest.raises(DataError, match=complaint):
            read_tracks(tmp_path / name, frame_rate=25)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"frame_rate": 0}, "frame rate of 0"),
        ({"frame_rate": float("nan")}, "frame rate of nan"),
        ({"image_size": (0, 5)}, "image size of 0 x 5"),
        ({"person": "tallest"}, "person 'tallest'"),
        ({"skeleton": "kinect"}, "unknown skeleton 'kinect'"),
        ({"min_confidence": 7}, "least confidence of 7"),
    ],
)
def test_impossible_settings_are_refused_before_the_file_is_read(
    tmp_path: Path, options: dict[str, object], complaint: str
) -> None:
    with pytest.raises(UsageError, match=complaint):
        read_tracks(tmp_path / "absent.json", **options)  # type: ignore[arg-type]


def test_hidden_files_of_a_folder_are_none_of_its_pictures(tmp_path: Path) -> None:
    folder = openpose(tmp_path, scene("body25"))
    (folder / "._take2_000000000003_keypoints.json").write_bytes(b"\x00\x05\x16\x07")
    assert len(read_tracks(folder, frame_rate=RATE).tracks) == 2


def test_a_folder_of_two_formats_is_refused(tmp_path: Path) -> None:
    folder = openpose(tmp_path, scene("body25"))
    (folder / "other.json").write_text('[{"image_id": 5, "keypoints": [1, 2, 3]}]')
    with pytest.raises(
        DataError, match=r"other.json is of keypoint results.* of OpenPose|OpenPose"
    ):
        read_tracks(folder, frame_rate=RATE)


def test_a_folder_without_anyone_is_refused(tmp_path: Path) -> None:
    folder = openpose(tmp_path, {n: [] for n in range(3)})
    with pytest.raises(DataError, match="no person in any of 3 pictures"):
        read_tracks(folder, frame_rate=25)
    assert read_tracks(folder, frame_rate=25, skeleton="body25").tracks == []


def test_pictures_of_different_sizes_are_no_video(tmp_path: Path) -> None:
    path = coco(tmp_path, scene("coco17"))
    content = json.loads(path.read_text())
    content["images"][4]["width"] = 1920
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=r"different sizes \(640 x 360 and 1920 x 360\)"):
        read_tracks(path, frame_rate=RATE)
    (track,) = read_tracks(path, independent=True).tracks
    assert track.image_size == (0, 0)
    found = read_tracks(path, frame_rate=RATE, image_size=(WIDTH, HEIGHT))
    assert any("640 x 360 was given and holds" in note for note in found.notes)


def test_a_track_file_says_itself_what_options_would(tmp_path: Path) -> None:
    (track, _) = read_tracks(coco(tmp_path, scene("coco17")), frame_rate=RATE).tracks
    path = tmp_path / "T.npz"
    write_track(path, track)
    (again,) = read_tracks(path).tracks
    np.testing.assert_array_equal(again.frame, track.frame)
    with pytest.raises(UsageError, match="itself what --frame-rate and --skeleton and"):
        read_tracks(path, frame_rate=10, skeleton="h36m17", image_size=(10, 10))
    with pytest.raises(UsageError, match="holds person 1 alone, 2 was asked for"):
        read_tracks(path, person=2)
    with pytest.raises(UsageError, match="leave it out"):
        lift(path, output=tmp_path / "out.npz", skeleton="h36m17")
    assert not (tmp_path / "out.npz").exists()


def test_scattered_people_do_not_take_all_memory(tmp_path: Path) -> None:
    """Frame numbers far apart, and people whose rows would be millions."""
    frames = scene("coco17", [0, 1, 2, 10**9, 10**9 + 1, 10**9 + 2])
    found = read_tracks(MADE["sleap csv"].write(tmp_path, frames), frame_rate=RATE)
    assert sum(len(track) for track in found.tracks) < 400
    found = read_tracks(
        MADE["alphapose"].write(tmp_path, scene("halpe26", frames)), frame_rate=RATE
    )
    assert sum(len(track) for track in found.tracks) < 400


def test_npz_files_that_claim_anything_are_refused(tmp_path: Path) -> None:
    import zipfile

    def claim(header: bytes, *, version: bytes = b"\x01\x00") -> Path:
        size = len(header).to_bytes(2 if version == b"\x01\x00" else 4, "little")
        with zipfile.ZipFile(tmp_path / "claim.npz", "w") as archive:
            archive.writestr("xy.npy", b"\x93NUMPY" + version + size + header)
        return tmp_path / "claim.npz"

    shapes = ["(1000000000000,)", "(0, 1000000000000000000000000)", "(" + "1, " * 90 + ")", "(-1,)"]
    for shape in shapes:
        for dtype in ("<f8", "<U0", "|S0", "|V0", "<f99", "O"):
            text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}}}"
            with pytest.raises(DataError, match=r"claim\.npz"):
                read_arrays(claim(text.encode()))
    for header in (b"(" * 9000, b"[" * 60_000, b"{" + b"'a': " * 5000, b"\xff" * 200):
        with pytest.raises(DataError, match=r"claim\.npz"):
            read_arrays(claim(header))
        with pytest.raises(DataError, match=r"claim\.npz"):
            read_arrays(claim(header, version=b"\x02\x00"))


def test_h5_files_that_claim_much_or_lie_elsewhere_are_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "labels.h5"

    def write(**tracks: object) -> Path:
        with h5py.File(path, "w") as file:
            file["node_names"] = np.array([b"nose", b"left_hip"])
            file.create_dataset("tracks", dtype="f8", **tracks)
        return path

    with pytest.raises(DataError, match=r"shape \(1, 2, 2, 1000000000000\) would take"):
        read_tracks(write(shape=(1, 2, 2, 10**12), chunks=(1, 2, 2, 1000)), frame_rate=25)
    (tmp_path / "secret").write_bytes(bytes(800))
    with pytest.raises(DataError, match="lies in another file"):
        read_tracks(
            write(shape=(1, 2, 2, 9), external=[(str(tmp_path / "secret"), 0, 800)]), frame_rate=25
        )
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other.create_dataset("tracks", data=np.zeros((1, 2, 2, 9)))
    with h5py.File(path, "w") as file:
        file["node_names"] = np.array([b"nose", b"left_hip"])
        file["tracks"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "tracks")
    with pytest.raises(DataError, match="a link leads to another file"):
        read_tracks(path, frame_rate=25)
