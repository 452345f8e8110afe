"""A tour of dance2pose from Python, cell by cell. Run it as it stands: it takes a minute.

It uses the bundled clip and the bundled models, so that it runs anywhere, offline. Open it as a
notebook with any editor that knows `# %%`.
"""

# %% One video: everything that is known of its dancers, and nothing written.
import sys
import tempfile
from pathlib import Path

import numpy as np

import dance2pose as d2p
from dance2pose.assets import asset

clip, detector, pose = (
    asset(f"demo_{name}") for name in ("clip.mp4", "detector.onnx", "pose.onnx")
)
seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
r = d2p.analyse(clip, detector=detector, pose=pose, person="largest", height_m=1.6, end_s=seconds)
print(r)

# %% A dancer: 2D keypoints, and 3D joints about the pelvis, on one timeline.
dancer = r.dancers[0]
print(dancer.keypoints)
print(dancer.smoothed)
names = d2p.skeletons.get(dancer.smoothed.skeleton).joints
print(dict(zip(names[:4], dancer.smoothed.xyz[0, :4].round(2).tolist(), strict=True)))

# %% Missing is NaN, and every joint says how sure it is of its place.
print(f"{np.isnan(dancer.smoothed.xyz).any(axis=(1, 2)).sum()} frames without a pose")
if dancer.smoothed.sigma is not None:
    print(f"sigma of the wrists: {np.nanmean(dancer.smoothed.sigma[:, [4, 7]]):.3f} m")

# %% What to know before use.
print(r.findings or "nothing to report")

# %% Smooth, as the paper does.
smoother = d2p.smooth(dancer.raw, model="mma", window=5)
print(f"moved by {1000 * np.nanmean(np.linalg.norm(smoother.xyz - dancer.raw.xyz, axis=2)):.0f} mm")

# %% Keypoints of any tool, as plain arrays, to 3D.
track = d2p.Track2D.from_arrays(
    dancer.keypoints.xy[:20],
    confidence=dancer.keypoints.confidence[:20],
    time_s=dancer.keypoints.time_s[:20],
    skeleton=dancer.keypoints.skeleton,
    image_size=dancer.keypoints.image_size,
)
print(d2p.lift(track, height_m=1.6))

# %% Files: the suffix decides the form.
with tempfile.TemporaryDirectory() as folder:
    print([path.name for path in r.save(Path(folder) / "clip.npz")])
    print([path.name for path in r.save(Path(folder) / "clip.rrd", picture="none")])
    print(d2p.load(Path(folder) / "clip.npz") == dancer.smoothed)
