"""What a batch can be told beyond the settings of a reconstruction."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from dance2pose.errors import UsageError

# As Dask takes them: perhaps a protocol, a host, a port.
_ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:[0-9]{1,5}/?")


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """How a batch runs: where, how many at once, and when it gives an item up."""

    workers: int | None = None
    """Videos processed at once; what cores and memory allow if not given."""
    attempts: int = 3
    """Times an item that took its worker down is tried before it counts as failed."""
    time_limit_min: float = 240.0
    """Minutes that one item may take."""
    memory_limit_gb: float = 4.0
    """Memory that the worker of one item may take, in GB."""
    cluster: str | None = None
    """Address of a Dask scheduler, as tcp://host:8786, that runs the items instead."""
    resources: str | None = None
    """What an item needs of a cluster's worker, as GPU=1 or GPU=1,MEMORY=8e9."""

    def __post_init__(self) -> None:
        _require(
            self.workers is None or 1 <= self.workers <= 1024,
            f"workers {self.workers}: expected 1 to 1024",
        )
        _require(self.attempts >= 1, f"attempts {self.attempts}: expected 1 or more")
        _require(
            self.time_limit_min > 0, f"time-limit {self.time_limit_min}: expected minutes above 0"
        )
        _require(
            self.memory_limit_gb >= 0.1,
            f"memory-limit {self.memory_limit_gb}: expected GB, 0.1 or more",
        )
        _require(
            self.resources is None or self.cluster is not None,
            "resources: is about the workers of a cluster; give cluster as well",
        )
        _require(
            self.cluster is None or _ADDRESS.fullmatch(self.cluster) is not None,
            f"cluster {self.cluster}: expected a scheduler's address, as tcp://host:8786",
        )
        _require(
            self.cluster is None or self.workers is None,
            "workers: a cluster says itself how many workers it has; leave it out",
        )
        _ = self.needed_resources

    @property
    def needed_resources(self) -> dict[str, float]:
        """`resources` by name. Raises UsageError for what is not NAME=NUMBER."""
        needed: dict[str, float] = {}
        for part in (self.resources or "").split(","):
            name, _, amount = part.partition("=")
            if not part.strip():
                continue
            try:
                needed[name.strip()] = float(amount)
            except ValueError:
                raise UsageError(f"resources {part!r}: expected NAME=NUMBER, as GPU=1") from None
        return needed

    @property
    def local_workers(self) -> int:
        """Workers on this machine: one a core, as far as each gets its memory."""
        import psutil

        if self.workers is not None:
            return self.workers
        usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
        cores = usable or os.cpu_count() or 1
        fitting = int(psutil.virtual_memory().total / (self.memory_limit_gb * 1e9))
        return max(1, min(cores, fitting))


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise UsageError(message)
