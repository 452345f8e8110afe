"""provenance.json: what a package was made from, with the terms of W3C PROV (PROV-JSON)."""

from __future__ import annotations

import json
import platform
import socket
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dance2pose import __version__
from dance2pose.archive.jobs import Job
from dance2pose.assets import models_folder
from dance2pose.file_hash import sha256_now
from dance2pose.provenance import Provenance, SourceFile

_SHIPPED = (".npz", ".onnx")


def document(
    job: Job, provenance: Provenance, outputs: list[Path], *, started: float, ended: float
) -> dict[str, Any]:
    """A PROV-JSON document of one item. outputs: the files of the package so far."""
    used = {"d2p:source": _entity(provenance.source, "source video")}
    for role, model in provenance.models.items():
        used[f"d2p:model-{role}"] = _entity(model, f"ONNX model: {role}")
    used.update(_shipped())
    made = {
        f"d2p:output-{n}": {"prov:label": path.name, "d2p:sha256": sha256_now(path)}
        for n, path in enumerate(outputs, start=1)
    }
    return {
        "prefix": {"prov": "http://www.w3.org/ns/prov#", "d2p": "urn:dance2pose:"},
        "entity": {**used, **made},
        "activity": {
            "d2p:reconstruction": {
                "prov:type": "reconstruction of 3D motion from one camera",
                "prov:startTime": _moment(started),
                "prov:endTime": _moment(ended),
                "d2p:item": job.item,
                "d2p:version": job.version,
                "d2p:fingerprint": job.fingerprint,
                "d2p:settings": dict(provenance.settings),
                "d2p:stages": dict(provenance.stages),
                "d2p:warnings": list(provenance.warnings),
            }
        },
        "agent": {
            "d2p:software": {
                "prov:type": "prov:SoftwareAgent",
                "prov:label": f"dance2pose {__version__}",
                "d2p:versions": dict(provenance.versions),
                "d2p:machine": _machine(),
            }
        },
        "used": {
            f"_:used-{n}": {"prov:activity": "d2p:reconstruction", "prov:entity": name}
            for n, name in enumerate(used, start=1)
        },
        "wasGeneratedBy": {
            f"_:made-{n}": {"prov:activity": "d2p:reconstruction", "prov:entity": name}
            for n, name in enumerate(made, start=1)
        },
        "wasAssociatedWith": {
            "_:by": {"prov:activity": "d2p:reconstruction", "prov:agent": "d2p:software"}
        },
    }


def write(path: Path, content: dict[str, Any]) -> None:
    """Write the document as JSON."""
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _entity(file: SourceFile, kind: str) -> dict[str, Any]:
    return {
        "prov:type": kind,
        "prov:label": file.name,
        "d2p:sha256": file.sha256,
        "d2p:size-bytes": file.size_bytes,
        **{f"d2p:{name.replace(' ', '-')}": value for name, value in file.details.items()},
    }


def _shipped() -> dict[str, dict[str, Any]]:
    """The learned arrays and networks that come with the program: any of them may have a part."""
    return {
        f"d2p:shipped-{path.stem}": {
            "prov:type": "learned array or network that comes with dance2pose",
            "prov:label": path.name,
            "d2p:sha256": sha256_now(path),
        }
        for path in sorted(models_folder().iterdir())
        if path.suffix in _SHIPPED and not path.name.startswith("demo_")
    }


def _machine() -> dict[str, str]:
    return {"host": socket.gethostname(), "system": platform.platform(), "cpu": platform.machine()}


def _moment(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")
