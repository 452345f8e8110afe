"""ELAN annotation files (.eaf, EAF 3.0), and the same as a table.

A dancer has two tiers: phrases, and key poses, each as long as a frame. Times are whole
milliseconds of the video, which is linked and not copied.
"""

from __future__ import annotations

import csv
import mimetypes
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from dance2pose.even_rate import step_s
from dance2pose.export.scene import ExportScene, SceneDancer
from dance2pose.phrases import Phrase, find_phrases

_SCHEMA = "http://www.mpi.nl/tools/elan/EAFv3.0.xsd"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_TYPE = "motion"
# start ms, end ms, value
Note = tuple[int, int, str]


def write_eaf(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write phrases and key poses of all dancers, linked to the video where it is known."""
    tiers: dict[str, list[Note]] = {}
    for dancer in scene.dancers:
        phrases = find_phrases(dancer.poses)
        tiers[dancer.name] = [_phrase_note(phrase) for phrase in phrases]
        tiers[f"{dancer.name} key poses"] = _key_pose_notes(dancer, phrases)
    root = _document(scene, path)
    _add_tiers(root, tiers)
    _add_types(root)
    ET.indent(root, "    ")
    text = ET.tostring(root, encoding="unicode")
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', encoding="utf-8")
    return () if scene.video else ("no video is linked; give it with --video",)


def write_phrases(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write the same as a table: a row a phrase, and a row a key pose."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["dancer", "kind", "phrase", "start_s", "end_s", "frame", "energy"])
        for dancer in scene.dancers:
            for p in find_phrases(dancer.poses):
                span = (f"{p.start_s:.6f}", f"{p.end_s:.6f}")
                table.writerow([dancer.person, "phrase", p.number, *span, "", f"{p.energy:.6g}"])
                for pose in p.key_poses:
                    at = f"{pose.time_s:.6f}"
                    row = [dancer.person, "key pose", p.number, at, at, pose.frame]
                    table.writerow([*row, f"{pose.energy:.6g}"])
    return ()


def _phrase_note(phrase: Phrase) -> Note:
    return _ms(phrase.start_s), _ms(phrase.end_s), f"phrase {phrase.number}"


def _key_pose_notes(dancer: SceneDancer, phrases: Sequence[Phrase]) -> list[Note]:
    """Key poses in order, none over the next: ELAN allows no overlap in a tier."""
    long = max(1, _ms(step_s(dancer.poses.time_s)))
    poses = [pose for phrase in phrases for pose in phrase.key_poses]
    starts = [_ms(pose.time_s) for pose in poses]
    ends = [
        min(start + long, following)
        for start, following in zip(starts, [*starts[1:], 2**62], strict=False)
    ]
    return [
        (start, end, f"key pose {i} (frame {pose.frame})")
        for i, (start, end, pose) in enumerate(zip(starts, ends, poses, strict=True), start=1)
        if end > start
    ]


def _ms(time_s: float) -> int:
    return max(0, round(time_s * 1000))


def _document(scene: ExportScene, path: Path) -> ET.Element:
    root = ET.Element(
        "ANNOTATION_DOCUMENT",
        {
            "AUTHOR": "dance2pose",
            "DATE": datetime.now(UTC).isoformat(timespec="seconds"),
            "FORMAT": "3.0",
            "VERSION": "3.0",
            f"{{{_INSTANCE}}}noNamespaceSchemaLocation": _SCHEMA,
        },
    )
    ET.register_namespace("xsi", _INSTANCE)
    header = ET.SubElement(root, "HEADER", {"MEDIA_FILE": "", "TIME_UNITS": "milliseconds"})
    if scene.video is not None:
        kind = mimetypes.guess_type(scene.video.name)[0] or "video/*"
        video = scene.video.resolve()
        ET.SubElement(
            header,
            "MEDIA_DESCRIPTOR",
            {
                "MEDIA_URL": video.as_uri(),
                "MIME_TYPE": kind,
                "RELATIVE_MEDIA_URL": _relative(video, path.resolve().parent),
            },
        )
    ET.SubElement(header, "PROPERTY", {"NAME": "dance2pose"}).text = scene.provenance_json()
    return root


def _relative(video: Path, folder: Path) -> str:
    import os

    try:
        return "./" + os.path.relpath(video, folder).replace(os.sep, "/")
    except ValueError:  # another drive
        return video.name


def _add_tiers(root: ET.Element, tiers: dict[str, list[Note]]) -> None:
    order = ET.SubElement(root, "TIME_ORDER")
    slots = annotations = 0
    for name, notes in tiers.items():
        dancer = name.split()[0]
        attributes = {"LINGUISTIC_TYPE_REF": _TYPE, "TIER_ID": name, "PARTICIPANT": dancer}
        tier = ET.SubElement(root, "TIER", attributes)
        for start, end, value in notes:
            references = []
            for time in (start, end):
                slots += 1
                slot = {"TIME_SLOT_ID": f"ts{slots}", "TIME_VALUE": str(time)}
                ET.SubElement(order, "TIME_SLOT", slot)
                references.append(f"ts{slots}")
            annotations += 1
            ids = {"ANNOTATION_ID": f"a{annotations}"}
            places = dict(zip(("TIME_SLOT_REF1", "TIME_SLOT_REF2"), references, strict=True))
            note = ET.SubElement(tier, "ANNOTATION")
            aligned = ET.SubElement(note, "ALIGNABLE_ANNOTATION", ids | places)
            ET.SubElement(aligned, "ANNOTATION_VALUE").text = value


def _add_types(root: ET.Element) -> None:
    kind = {
        "GRAPHIC_REFERENCES": "false",
        "LINGUISTIC_TYPE_ID": _TYPE,
        "TIME_ALIGNABLE": "true",
    }
    ET.SubElement(root, "LINGUISTIC_TYPE", kind)
