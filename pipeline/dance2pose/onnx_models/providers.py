"""The hardware that runs a model: ONNX Runtime's execution providers under names people know.

Which providers there are is a matter of the ONNX Runtime package that is installed: the plain one
has the processor alone (on a Mac also CoreML), onnxruntime-gpu adds CUDA and TensorRT,
onnxruntime-openvino and onnxruntime-directml theirs. Only one of these packages can be installed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dance2pose.errors import UsageError

CPU = "CPUExecutionProvider"

# By the name of `--provider`: ONNX Runtime's own, and the package that brings it.
KNOWN = {
    "cpu": (CPU, "onnxruntime"),
    "cuda": ("CUDAExecutionProvider", "onnxruntime-gpu"),
    "tensorrt": ("TensorrtExecutionProvider", "onnxruntime-gpu and TensorRT"),
    "openvino": ("OpenVINOExecutionProvider", "onnxruntime-openvino"),
    "coreml": ("CoreMLExecutionProvider", "onnxruntime on macOS"),
    "directml": ("DmlExecutionProvider", "onnxruntime-directml"),
}

# What `auto` tries, the fastest first. TensorRT is left out: it takes minutes to prepare a model.
# OpenVINO too: it runs small person models no faster than the processor alone does (measured).
AUTO = ("cuda", "directml", "coreml", "cpu")


@dataclass(frozen=True)
class ProviderChoice:
    """ONNX Runtime's providers to try, in order, the processor last; note: what was not to be had.

    wanted: the name that was asked for, or that `auto` came to.
    """

    wanted: str
    providers: tuple[str, ...]
    note: str | None = None


def choose_provider(name: str, offered: Sequence[str]) -> ProviderChoice:
    """The providers for `name` (auto or one of `KNOWN`) among those that are offered.

    Where it is not offered the processor runs the model, and `note` says so. Raises UsageError
    for a name that is not known.

    >>> choose_provider("auto", ["CUDAExecutionProvider", CPU]).providers
    ('CUDAExecutionProvider', 'CPUExecutionProvider')
    """
    if name == "auto":
        name = next((known for known in AUTO if KNOWN[known][0] in offered), "cpu")
    if name not in KNOWN:
        raise UsageError(f"provider {name!r}: expected auto or one of {', '.join(KNOWN)}")
    wanted, package = KNOWN[name]
    if wanted == CPU:
        return ProviderChoice(name, (CPU,))
    if wanted not in offered:
        return ProviderChoice(
            name,
            (CPU,),
            f"{name} was asked for, but ONNX Runtime offers {', '.join(offered)} here: the models "
            f"run on the processor, much slower perhaps; {name} comes with the package {package} "
            "in the place of onnxruntime",
        )
    return ProviderChoice(name, (wanted, CPU))


def what_ran(choice: ProviderChoice, active: Sequence[str]) -> str | None:
    """What a session that came up with the providers `active` has to say, None if nothing.

    A provider can be offered and still fail where its driver or its libraries are missing; ONNX
    Runtime then falls back to the processor by itself.
    """
    if choice.note is not None or choice.providers[0] in active:
        return choice.note
    return (
        f"{choice.wanted} is offered by ONNX Runtime but did not come up (its driver or libraries "
        f"are missing or too old): the model runs with {', '.join(active)}"
    )
